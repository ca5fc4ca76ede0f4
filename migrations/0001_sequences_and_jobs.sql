-- What was submitted: the sequences whose files lie in the data folder, and the queue of jobs over them.
--
-- All times are milliseconds since 1970-01-01 UTC. JSON columns hold what only the program interprets; whatever a query
-- filters or sorts by is a column of its own.

CREATE TABLE sequences (
    id            INTEGER PRIMARY KEY,
    -- SHA-256 over manifest and files, in hexadecimal: the identity of the content, and the name of its folder.
    hash          TEXT    NOT NULL UNIQUE,
    -- The name it was last put under. Several contents may share one; the name then means the latest put.
    name          TEXT    NOT NULL,
    manifest      TEXT    NOT NULL CHECK (json_valid(manifest)),
    render_width  INTEGER NOT NULL,
    render_height INTEGER NOT NULL,
    output_width  INTEGER NOT NULL,
    output_height INTEGER NOT NULL,
    n_frames      INTEGER NOT NULL,
    -- Size of the folder on disk.
    n_bytes       INTEGER NOT NULL,
    put_at        INTEGER NOT NULL
) STRICT;

CREATE INDEX sequences_by_name ON sequences (name, put_at);

-- AUTOINCREMENT: the number of a deleted job must never name another one, because people and folders refer to it.
CREATE TABLE jobs (
    id               INTEGER PRIMARY KEY AUTOINCREMENT,
    sequence_id      INTEGER NOT NULL REFERENCES sequences (id),
    spec             TEXT    NOT NULL CHECK (json_valid(spec)),
    git_branch       TEXT,
    git_commit       TEXT,
    label            TEXT,
    status           TEXT    NOT NULL CHECK (status IN ('queued', 'running', 'done', 'failed', 'cancelled')),
    -- Started attempts that were not handed back; bounds retries, also of jobs that kill the process.
    attempts         INTEGER NOT NULL DEFAULT 0,
    -- Rises with every claim: a worker that lost its claim can no longer write to the job.
    lease            INTEGER NOT NULL DEFAULT 0,
    lease_until      INTEGER,
    n_done           INTEGER NOT NULL DEFAULT 0,
    n_total          INTEGER NOT NULL DEFAULT 0,
    cancel_requested INTEGER NOT NULL DEFAULT 0 CHECK (cancel_requested IN (0, 1)),
    error_kind       TEXT CHECK (error_kind IN ('input', 'device', 'internal')),
    error_code       TEXT,
    error_message    TEXT,
    created_at       INTEGER NOT NULL,
    started_at       INTEGER,
    finished_at      INTEGER,
    CHECK ((status = 'running') = (lease_until IS NOT NULL)),
    CHECK ((status = 'failed') = (error_code IS NOT NULL))
) STRICT;

-- Claiming looks for the oldest waiting job; the finished ones, nearly all, stay out of this index.
CREATE INDEX jobs_open ON jobs (status, id) WHERE status IN ('queued', 'running');
CREATE INDEX jobs_by_sequence ON jobs (sequence_id, id);
