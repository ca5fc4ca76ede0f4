-- What came out: one report for each preset of a finished job, with its rows.
--
-- The question asked most is "this metric, over time, on the same sequence, recipe and adapter". Such a line of reports
-- is a row of `series`; a report names its series, and the index on (series_id, id) walks it in time order however
-- long the history of the others grows. Names that repeat in every row are integers into small tables.

CREATE TABLE adapters (
    id             INTEGER PRIMARY KEY,
    name           TEXT NOT NULL,
    backend        TEXT NOT NULL,
    kind           TEXT NOT NULL,
    driver         TEXT NOT NULL,
    driver_version TEXT NOT NULL,
    UNIQUE (name, backend, kind, driver, driver_version)
) STRICT;

-- A preset with its parameters in full. `overrides` are the ones the submitter changed, for showing only.
CREATE TABLE variants (
    id         INTEGER PRIMARY KEY,
    preset     TEXT NOT NULL,
    history    TEXT NOT NULL,
    parameters TEXT NOT NULL CHECK (json_valid(parameters)),
    overrides  TEXT NOT NULL CHECK (json_valid(overrides)),
    UNIQUE (preset, history, parameters)
) STRICT;

CREATE TABLE series (
    id               INTEGER PRIMARY KEY,
    sequence_id      INTEGER NOT NULL REFERENCES sequences (id),
    variant_id       INTEGER NOT NULL REFERENCES variants (id),
    adapter_id       INTEGER NOT NULL REFERENCES adapters (id),
    latest_report_id INTEGER REFERENCES reports (id),
    UNIQUE (sequence_id, variant_id, adapter_id)
) STRICT;

CREATE TABLE metrics (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE) STRICT;
CREATE TABLE passes (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE) STRICT;

CREATE TABLE reports (
    id           INTEGER PRIMARY KEY AUTOINCREMENT,
    job_id       INTEGER NOT NULL REFERENCES jobs (id),
    -- Position in the job's list of presets; also the name of the folder with its images.
    preset_index INTEGER NOT NULL,
    series_id    INTEGER NOT NULL REFERENCES series (id),
    revision     TEXT    NOT NULL,
    notes        TEXT    NOT NULL CHECK (json_valid(notes)),
    -- Wall time of each stage of the whole job.
    stages_ms    TEXT    NOT NULL CHECK (json_valid(stages_ms)),
    -- GPU time of one frame: the sum of its passes' medians. NULL where the adapter has no timestamps.
    gpu_time_ms  REAL,
    created_at   INTEGER NOT NULL,
    UNIQUE (job_id, preset_index)
) STRICT;

CREATE INDEX reports_by_series ON reports (series_id, id);

-- A number is either `value`, or one of those that REAL columns and JSON cannot hold and `special` names.
CREATE TABLE report_metrics (
    report_id INTEGER NOT NULL REFERENCES reports (id) ON DELETE CASCADE,
    metric_id INTEGER NOT NULL REFERENCES metrics (id),
    version   INTEGER NOT NULL,
    -- The one number that stands for the sequence: the mean of its frames after warm-up.
    value     REAL,
    special   TEXT CHECK (special IN ('inf', '-inf', 'nan')),
    summary   TEXT NOT NULL CHECK (json_valid(summary)),
    PRIMARY KEY (report_id, metric_id),
    CHECK ((value IS NULL) = (special IS NOT NULL))
) STRICT, WITHOUT ROWID;

CREATE TABLE report_passes (
    report_id  INTEGER NOT NULL REFERENCES reports (id) ON DELETE CASCADE,
    pass_id    INTEGER NOT NULL REFERENCES passes (id),
    median_ms  REAL    NOT NULL,
    min_ms     REAL    NOT NULL,
    mad_ms     REAL    NOT NULL,
    n_samples  INTEGER NOT NULL,
    PRIMARY KEY (report_id, pass_id)
) STRICT, WITHOUT ROWID;

CREATE TABLE frames (
    report_id         INTEGER NOT NULL REFERENCES reports (id) ON DELETE CASCADE,
    frame_index       INTEGER NOT NULL,
    reset             INTEGER NOT NULL CHECK (reset IN (0, 1)),
    warmup            INTEGER NOT NULL CHECK (warmup IN (0, 1)),
    repaired_texels   INTEGER NOT NULL,
    non_finite_pixels INTEGER NOT NULL,
    PRIMARY KEY (report_id, frame_index)
) STRICT, WITHOUT ROWID;

CREATE TABLE frame_metrics (
    report_id   INTEGER NOT NULL,
    frame_index INTEGER NOT NULL,
    metric_id   INTEGER NOT NULL REFERENCES metrics (id),
    value       REAL,
    special     TEXT CHECK (special IN ('inf', '-inf', 'nan')),
    PRIMARY KEY (report_id, frame_index, metric_id),
    FOREIGN KEY (report_id, frame_index) REFERENCES frames (report_id, frame_index) ON DELETE CASCADE,
    CHECK ((value IS NULL) = (special IS NOT NULL))
) STRICT, WITHOUT ROWID;

CREATE TABLE pass_times (
    report_id   INTEGER NOT NULL,
    frame_index INTEGER NOT NULL,
    pass_id     INTEGER NOT NULL REFERENCES passes (id),
    time_ms     REAL    NOT NULL,
    PRIMARY KEY (report_id, frame_index, pass_id),
    FOREIGN KEY (report_id, frame_index) REFERENCES frames (report_id, frame_index) ON DELETE CASCADE
) STRICT, WITHOUT ROWID;
