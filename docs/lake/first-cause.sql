-- First cause per stop. A stop is a node that fell silent, restarted or left operational without a command; its cause is that
-- of its story.
SELECT machine, strftime(min(time), '%Y-%m-%d %H:%M:%S') AS time, min_by(node_name, time) AS node,
    min_by(rule, time) AS stop, any_value(story_title) AS first_cause
FROM findings
WHERE standing = 'new' AND rule IN ('node-lost', 'unexpected-boot', 'operational-lost')
GROUP BY machine, capture_hash, story
ORDER BY time
LIMIT 10;
