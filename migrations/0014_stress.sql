-- Stress runs: jobs that make their own frames, and the cells of their matrices.
--
-- Such a job has no sequence, so jobs.sequence_id may be NULL from here on. SQLite cannot drop a constraint by ALTER TABLE, and to
-- build the table anew would need every column by name, whatever other migrations added. Its documentation allows to edit the
-- schema's text where, as here, what is stored does not change.
PRAGMA writable_schema = ON;
UPDATE sqlite_schema
SET sql = replace(sql, 'sequence_id      INTEGER NOT NULL REFERENCES', 'sequence_id      INTEGER REFERENCES')
WHERE type = 'table' AND name = 'jobs';
PRAGMA writable_schema = RESET;

CREATE TABLE stress_reports (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    job_id     INTEGER NOT NULL UNIQUE REFERENCES jobs (id),
    -- Name, driver and its version: what a cell says holds for them alone.
    adapter_id INTEGER NOT NULL REFERENCES adapters (id),
    revision   TEXT    NOT NULL,
    seed       INTEGER NOT NULL,
    created_at INTEGER NOT NULL
) STRICT;

CREATE TABLE stress_cells (
    report_id  INTEGER NOT NULL REFERENCES stress_reports (id) ON DELETE CASCADE,
    -- Position in the matrix; also the name of the cell's picture.
    cell_index INTEGER NOT NULL,
    hazard     TEXT    NOT NULL,
    recipe     TEXT    NOT NULL,
    verdict    TEXT    NOT NULL CHECK (verdict IN ('not_run', 'pass', 'degrades', 'fails')),
    -- Everything else that the program interprets.
    cell       TEXT    NOT NULL CHECK (json_valid(cell)),
    PRIMARY KEY (report_id, cell_index)
) STRICT, WITHOUT ROWID;
