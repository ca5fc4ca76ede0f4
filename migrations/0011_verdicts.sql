-- What is good enough, who said so, and what was found wanting.

-- The rules that a branch's last run was sent with. Rules that are no longer among them have no alerts.
CREATE TABLE rule_sets (
    project_id INTEGER NOT NULL REFERENCES projects (id),
    branch     TEXT    NOT NULL,
    rules      TEXT    NOT NULL CHECK (json_valid(rules)),
    updated_at INTEGER NOT NULL,
    PRIMARY KEY (project_id, branch)
) STRICT;

-- What people said of a result. A line's baseline is the set of results whose last word is 'approved'.
CREATE TABLE decisions (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    report_id  INTEGER NOT NULL REFERENCES reports (id) ON DELETE CASCADE,
    series_id  INTEGER NOT NULL REFERENCES series (id),
    decision   TEXT    NOT NULL CHECK (decision IN ('approved', 'rejected')),
    who        TEXT    NOT NULL,
    why        TEXT    NOT NULL,
    decided_at INTEGER NOT NULL
) STRICT;
CREATE INDEX decisions_by_series ON decisions (series_id, id);
CREATE INDEX decisions_by_report ON decisions (report_id, id);

CREATE TABLE alerts (
    id          INTEGER PRIMARY KEY AUTOINCREMENT,
    project_id  INTEGER NOT NULL REFERENCES projects (id),
    branch      TEXT    NOT NULL,
    series_id   INTEGER NOT NULL REFERENCES series (id),
    metric      TEXT    NOT NULL,
    kind        TEXT    NOT NULL CHECK (kind IN ('limit', 'baseline', 'change', 'no_data')),
    status      TEXT    NOT NULL CHECK (status IN ('open', 'resolved', 'dismissed')),
    -- First bad and last good result; none where nothing was good before, or nothing came.
    report_id   INTEGER REFERENCES reports (id),
    last_good_report_id INTEGER REFERENCES reports (id),
    -- What was found, in JSON: values, effect with its interval, worst frames, words.
    finding     TEXT    NOT NULL CHECK (json_valid(finding)),
    closed_why  TEXT,
    closed_by   TEXT,
    opened_at   INTEGER NOT NULL,
    updated_at  INTEGER NOT NULL,
    closed_at   INTEGER
) STRICT;
-- The same fault found again is the same alert.
CREATE UNIQUE INDEX alerts_open ON alerts (branch, series_id, metric, kind) WHERE status = 'open';
CREATE INDEX alerts_by_project ON alerts (project_id, status, id);
