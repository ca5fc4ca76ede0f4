-- A line is judged by the rules that its last run on a branch was sent with: two pipelines of a branch may have a file each.

ALTER TABLE rule_sets RENAME TO branch_rules;
CREATE TABLE rule_sets (
    id    INTEGER PRIMARY KEY,
    rules TEXT    NOT NULL UNIQUE CHECK (json_valid(rules))
) STRICT;
INSERT INTO rule_sets (rules) SELECT DISTINCT rules FROM branch_rules;

CREATE TABLE line_rules (
    series_id   INTEGER NOT NULL REFERENCES series (id),
    -- Empty for none, as in alerts.
    branch      TEXT    NOT NULL,
    rule_set_id INTEGER NOT NULL REFERENCES rule_sets (id),
    -- What could not be told at the last verdict, in JSON: why, by metric.
    unknown     TEXT    NOT NULL DEFAULT '{}' CHECK (json_valid(unknown)),
    PRIMARY KEY (series_id, branch)
) STRICT, WITHOUT ROWID;
CREATE INDEX line_rules_by_set ON line_rules (rule_set_id);
CREATE INDEX line_rules_by_branch ON line_rules (branch);
INSERT INTO line_rules (series_id, branch, rule_set_id)
    SELECT DISTINCT reports.series_id, branch_rules.branch, rule_sets.id
    FROM reports LEFT JOIN branches ON branches.id = branch_id
    JOIN series ON series.id = reports.series_id
    JOIN branch_rules ON branch_rules.project_id = series.project_id AND branch_rules.branch = ifnull(branches.name, '')
    JOIN rule_sets USING (rules)
    WHERE complete;
DROP TABLE branch_rules;

-- What became of a line's changes is asked at each verdict.
CREATE INDEX alerts_by_line ON alerts (series_id, metric, kind, branch);
-- And when a line was last heard on a branch.
CREATE INDEX reports_by_branch ON reports (series_id, branch_id, id) WHERE complete;
