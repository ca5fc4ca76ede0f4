-- Results over the first frames alone do not compare with those over all: they are lines of their own.

-- NULL for all frames, and where it is not ours to know.
ALTER TABLE variants ADD COLUMN n_frames INTEGER;
DROP INDEX variants_distinct;
CREATE UNIQUE INDEX variants_distinct
    ON variants (kind, preset, ifnull(history, ''), ifnull(skip, ''), ifnull(n_frames, 0), parameters);
