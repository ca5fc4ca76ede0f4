-- Who may do what, answers kept for clients that ask again, and whom to tell.

-- A token is 256 random bits, so a plain SHA-256 of it can be neither guessed nor reversed.
CREATE TABLE tokens (
    id            INTEGER PRIMARY KEY AUTOINCREMENT,
    name          TEXT    NOT NULL,
    -- The text's first characters: finds it, and lets people tell tokens apart.
    handle        TEXT    NOT NULL UNIQUE,
    hash          BLOB    NOT NULL CHECK (length(hash) = 32),
    -- JSON list of: read, submit, approve, admin.
    scopes        TEXT    NOT NULL CHECK (json_valid(scopes)),
    -- Requests a minute; NULL for no limit.
    rate_per_minute INTEGER,
    created_at    INTEGER NOT NULL,
    expires_at    INTEGER,
    revoked_at    INTEGER
) STRICT;

CREATE TABLE idempotency_keys (
    -- Token's number (0 for none) and key.
    token_id    INTEGER NOT NULL,
    key         TEXT    NOT NULL,
    -- SHA-256 of method, path and body.
    fingerprint BLOB    NOT NULL,
    status      INTEGER NOT NULL,
    headers     TEXT    NOT NULL CHECK (json_valid(headers)),
    body        BLOB    NOT NULL,
    created_at  INTEGER NOT NULL,
    PRIMARY KEY (token_id, key)
) STRICT, WITHOUT ROWID;
CREATE INDEX idempotency_keys_by_age ON idempotency_keys (created_at);

CREATE TABLE webhooks (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    project_id INTEGER NOT NULL REFERENCES projects (id),
    url        TEXT    NOT NULL,
    -- Signs what is sent; it cannot be stored hashed.
    secret     TEXT    NOT NULL,
    created_at INTEGER NOT NULL
) STRICT;

CREATE TABLE deliveries (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    webhook_id INTEGER NOT NULL REFERENCES webhooks (id) ON DELETE CASCADE,
    event      TEXT    NOT NULL,
    payload    TEXT    NOT NULL CHECK (json_valid(payload)),
    attempts   INTEGER NOT NULL DEFAULT 0,
    -- NULL once it was delivered or given up.
    next_at    INTEGER,
    status     TEXT    NOT NULL DEFAULT 'waiting' CHECK (status IN ('waiting', 'delivered', 'given_up')),
    last_error TEXT,
    created_at INTEGER NOT NULL
) STRICT;
CREATE INDEX deliveries_due ON deliveries (next_at) WHERE next_at IS NOT NULL;
