-- no-transaction
-- Results measured elsewhere, and a history that answers fast.
--
-- A line of comparable results is now project x subject x system x environment. Its subject is a stored sequence or one
-- known by name only; its system a recipe run here or a program run elsewhere; its environment the adapter with its
-- driver, the operating system and how clocks are held. A report may have no job, and says where it came from itself.
--
-- A report's frames are packed (`frame_chunks`), its summaries are JSON in its own row, and the numbers that trends and
-- verdicts walk are in `points`, clustered by line, metric and branch. `convert.rs` moves what 0002 stored, because SQL
-- cannot pack numbers without losing their last bits, and drops the tables `report_metrics`, `report_passes`, `frames`,
-- `frame_metrics` and `pass_times`.
--
-- Three tables are rebuilt, as SQLite documents it: without foreign keys, which cannot be switched off in a transaction.

PRAGMA foreign_keys = OFF;
BEGIN;

CREATE TABLE projects (
    id         INTEGER PRIMARY KEY,
    name       TEXT    NOT NULL UNIQUE,
    created_at INTEGER NOT NULL
) STRICT;
INSERT INTO projects (id, name, created_at) VALUES (1, 'default', 0);

-- `parent_id` and `departed_report_id`: where the branch left its parent. What the parent measured up to that report is
-- this branch's past too.
CREATE TABLE branches (
    id                 INTEGER PRIMARY KEY,
    project_id         INTEGER NOT NULL REFERENCES projects (id),
    name               TEXT    NOT NULL,
    parent_id          INTEGER REFERENCES branches (id),
    departed_commit    TEXT,
    departed_report_id INTEGER NOT NULL DEFAULT 0,
    created_at         INTEGER NOT NULL,
    UNIQUE (project_id, name)
) STRICT;
INSERT INTO branches (project_id, name, created_at)
    SELECT 1, git_branch, min(created_at) FROM jobs WHERE git_branch IS NOT NULL GROUP BY git_branch;

CREATE TABLE environments (
    id         INTEGER PRIMARY KEY,
    adapter_id INTEGER NOT NULL REFERENCES adapters (id),
    os         TEXT    NOT NULL,
    clocks     TEXT    NOT NULL,
    UNIQUE (adapter_id, os, clocks)
) STRICT;
INSERT INTO environments (id, adapter_id, os, clocks) SELECT id, id, '', '' FROM adapters;

CREATE TABLE subjects (
    id          INTEGER PRIMARY KEY,
    sequence_id INTEGER UNIQUE REFERENCES sequences (id),
    -- Of a subject whose images were never put here.
    name        TEXT UNIQUE,
    CHECK ((sequence_id IS NULL) <> (name IS NULL))
) STRICT;
INSERT INTO subjects (sequence_id) SELECT id FROM sequences;

CREATE TABLE new_variants (
    id         INTEGER PRIMARY KEY,
    kind       TEXT NOT NULL CHECK (kind IN ('recipe', 'external')),
    -- The preset's id, or the name of the system elsewhere.
    preset     TEXT NOT NULL,
    -- NULL where it is not ours to know.
    history    TEXT,
    parameters TEXT NOT NULL CHECK (json_valid(parameters)),
    overrides  TEXT NOT NULL CHECK (json_valid(overrides))
) STRICT;
INSERT INTO new_variants SELECT id, 'recipe', preset, history, parameters, overrides FROM variants;
DROP TABLE variants;
ALTER TABLE new_variants RENAME TO variants;
CREATE UNIQUE INDEX variants_distinct ON variants (kind, preset, ifnull(history, ''), parameters);

CREATE TABLE new_series (
    id               INTEGER PRIMARY KEY,
    project_id       INTEGER NOT NULL REFERENCES projects (id),
    subject_id       INTEGER NOT NULL REFERENCES subjects (id),
    variant_id       INTEGER NOT NULL REFERENCES variants (id),
    environment_id   INTEGER NOT NULL REFERENCES environments (id),
    latest_report_id INTEGER REFERENCES reports (id),
    UNIQUE (project_id, subject_id, variant_id, environment_id)
) STRICT;
INSERT INTO new_series
    SELECT series.id, 1, subjects.id, variant_id, adapter_id, latest_report_id
    FROM series JOIN subjects ON subjects.sequence_id = series.sequence_id;
DROP TABLE series;
ALTER TABLE new_series RENAME TO series;

CREATE TABLE new_reports (
    id             INTEGER PRIMARY KEY AUTOINCREMENT,
    job_id         INTEGER REFERENCES jobs (id),
    preset_index   INTEGER NOT NULL,
    series_id      INTEGER NOT NULL REFERENCES series (id),
    branch_id      INTEGER REFERENCES branches (id),
    git_commit     TEXT,
    parent_commit  TEXT,
    pull_request   TEXT,
    engine_version TEXT,
    label          TEXT,
    labels         TEXT    NOT NULL DEFAULT '{}' CHECK (json_valid(labels)),
    revision       TEXT    NOT NULL,
    notes          TEXT    NOT NULL CHECK (json_valid(notes)),
    stages_ms      TEXT    NOT NULL CHECK (json_valid(stages_ms)),
    -- By metric: version and summary. By pass: its times.
    metrics        TEXT    NOT NULL DEFAULT '{}' CHECK (json_valid(metrics)),
    times_ms       TEXT    NOT NULL DEFAULT '{}' CHECK (json_valid(times_ms)),
    gpu_time_ms    REAL,
    -- 0 while frames are still being added one by one; such a report is in no list, trend or verdict.
    complete       INTEGER NOT NULL DEFAULT 1 CHECK (complete IN (0, 1)),
    created_at     INTEGER NOT NULL,
    UNIQUE (job_id, preset_index)
) STRICT;
INSERT INTO new_reports (id, job_id, preset_index, series_id, branch_id, git_commit, label, revision, notes, stages_ms,
                         gpu_time_ms, created_at)
    SELECT reports.id, job_id, preset_index, series_id, branches.id, git_commit, label, revision, notes, stages_ms,
           gpu_time_ms, reports.created_at
    FROM reports JOIN jobs ON jobs.id = job_id LEFT JOIN branches ON branches.name = git_branch;
DROP TABLE reports;
ALTER TABLE new_reports RENAME TO reports;
CREATE INDEX reports_by_series ON reports (series_id, id) WHERE complete;
CREATE INDEX reports_by_commit ON reports (git_commit, id) WHERE git_commit IS NOT NULL;
CREATE INDEX reports_open ON reports (created_at) WHERE NOT complete;

-- Which columns a chunk of frames has. Few combinations ever occur.
CREATE TABLE frame_layouts (
    id      INTEGER PRIMARY KEY,
    metrics TEXT NOT NULL CHECK (json_valid(metrics)),
    passes  TEXT NOT NULL CHECK (json_valid(passes)),
    UNIQUE (metrics, passes)
) STRICT;

-- Frames of a report: `columns.rs` has the format. A finished report is one chunk, a report posted frame by frame many;
-- where two speak of one frame the later one adds to the earlier.
CREATE TABLE frame_chunks (
    id        INTEGER PRIMARY KEY,
    report_id INTEGER NOT NULL REFERENCES reports (id) ON DELETE CASCADE,
    layout_id INTEGER NOT NULL REFERENCES frame_layouts (id),
    data      BLOB    NOT NULL
) STRICT;
CREATE INDEX frame_chunks_by_report ON frame_chunks (report_id, id);

-- The one number that stands for a report, by line and metric: the order in which trends and verdicts walk them.
-- `branch_id` is 0 for reports of no branch, `value` NULL for NaN (infinities are numbers).
CREATE TABLE points (
    series_id  INTEGER NOT NULL REFERENCES series (id),
    metric_id  INTEGER NOT NULL REFERENCES metrics (id),
    report_id  INTEGER NOT NULL,
    branch_id  INTEGER NOT NULL,
    created_at INTEGER NOT NULL,
    version    INTEGER NOT NULL,
    value      REAL,
    PRIMARY KEY (series_id, metric_id, report_id)
) STRICT, WITHOUT ROWID;

-- Every full run of points again, packed, so that a long trend is a few hundred rows.
CREATE TABLE point_blocks (
    series_id      INTEGER NOT NULL REFERENCES series (id),
    metric_id      INTEGER NOT NULL REFERENCES metrics (id),
    last_report_id INTEGER NOT NULL,
    data           BLOB    NOT NULL,
    PRIMARY KEY (series_id, metric_id, last_report_id)
) STRICT;

ALTER TABLE jobs ADD COLUMN project TEXT NOT NULL DEFAULT 'default';
-- Parent commit, pull request, engine version, labels, point of departure.
ALTER TABLE jobs ADD COLUMN provenance TEXT NOT NULL DEFAULT '{}' CHECK (json_valid(provenance));
UPDATE jobs SET provenance = json_object('branch', git_branch, 'commit', git_commit, 'label', label);
CREATE INDEX jobs_by_status ON jobs (status, id);

COMMIT;
PRAGMA foreign_keys = ON;
