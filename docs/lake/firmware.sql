-- Firmware against findings: errors per capture for each version (100A:00) of a node.
WITH firmware AS (
    SELECT capture_hash, node, any_value(text) AS version FROM objects WHERE object = '100A:00' GROUP BY ALL
), errors AS (
    SELECT capture_hash, node, rule, count(*) AS errors
    FROM findings WHERE severity = 'error' AND standing = 'new' GROUP BY ALL
)
SELECT version, coalesce(rule, 'none') AS rule, count(*) AS captures, CAST(coalesce(sum(errors), 0) AS INTEGER) AS errors
FROM firmware LEFT JOIN errors USING (capture_hash, node)
GROUP BY ALL
ORDER BY version, rule;
