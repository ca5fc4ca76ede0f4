-- A content may have several names, and a name leads to the content that was last put under it. `sequences.name` stays what a
-- content is called: the last name it was put under.

CREATE TABLE sequence_names (
    name        TEXT PRIMARY KEY,
    sequence_id INTEGER NOT NULL REFERENCES sequences (id) ON DELETE CASCADE
) STRICT, WITHOUT ROWID;

INSERT INTO sequence_names
SELECT name, id FROM sequences WHERE true ORDER BY put_at, id
ON CONFLICT (name) DO UPDATE SET sequence_id = excluded.sequence_id;
