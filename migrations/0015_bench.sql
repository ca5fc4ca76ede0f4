-- Benchmarks: run time against error of many settings of one sequence; and what makes a job the repetition of another.

CREATE TABLE bench_reports (
    id          INTEGER PRIMARY KEY AUTOINCREMENT,
    job_id      INTEGER NOT NULL UNIQUE REFERENCES jobs (id),
    sequence_id INTEGER NOT NULL REFERENCES sequences (id),
    -- Times are comparable on one adapter and driver only.
    adapter_id  INTEGER NOT NULL REFERENCES adapters (id),
    revision    TEXT    NOT NULL,
    -- Everything else that the program interprets: points, noise, clock, what was left out.
    report      TEXT    NOT NULL CHECK (json_valid(report)),
    created_at  INTEGER NOT NULL
) STRICT;

CREATE INDEX bench_reports_by_sequence ON bench_reports (sequence_id, job_id);

-- SHA-256 of all that the job's reports follow from. NULL where nothing may be answered from the store.
ALTER TABLE jobs ADD COLUMN result_key TEXT;
CREATE INDEX jobs_by_result ON jobs (result_key, id) WHERE result_key IS NOT NULL;
