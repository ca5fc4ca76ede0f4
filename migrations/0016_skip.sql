-- Times with and without work that was left out are not comparable: they are lines of their own.

-- NULL where it is not ours to know.
ALTER TABLE variants ADD COLUMN skip TEXT;
UPDATE variants SET skip = 'off' WHERE kind = 'recipe';
DROP INDEX variants_distinct;
CREATE UNIQUE INDEX variants_distinct ON variants (kind, preset, ifnull(history, ''), ifnull(skip, ''), parameters);
