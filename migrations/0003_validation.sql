-- How far the adapter's images are from the twin's on the CPU, for the reports of jobs that asked for it. `summary` is what
-- pages show; `frames` holds every pass of every frame, which only whoever looks for a fault wants.

CREATE TABLE validations (
    report_id INTEGER PRIMARY KEY REFERENCES reports (id) ON DELETE CASCADE,
    agrees    INTEGER NOT NULL CHECK (agrees IN (0, 1)),
    summary   TEXT    NOT NULL CHECK (json_valid(summary)),
    frames    TEXT    NOT NULL CHECK (json_valid(frames))
) STRICT;
