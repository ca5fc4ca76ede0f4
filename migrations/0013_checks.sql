-- What the convention check found in a sequence, so that its page can warn without reading a pixel again.
--
-- A sequence without a row of the check's current version is one that still waits, whether it came before this table, or
-- the service ended before its turn: nothing else says what is to be done. A newer check adds rows and leaves the old ones,
-- which are what it then said. Both outcomes end the waiting: a check that failed would fail again.

CREATE TABLE sequence_checks (
    sequence_id INTEGER NOT NULL REFERENCES sequences (id),
    version     INTEGER NOT NULL,
    -- The report as JSON, or why there is none.
    report      TEXT    CHECK (report IS NULL OR json_valid(report)),
    error       TEXT,
    n_warnings  INTEGER NOT NULL DEFAULT 0,
    time_ms     REAL    NOT NULL,
    checked_at  INTEGER NOT NULL,
    PRIMARY KEY (sequence_id, version),
    CHECK ((report IS NULL) = (error IS NOT NULL))
) STRICT, WITHOUT ROWID;
