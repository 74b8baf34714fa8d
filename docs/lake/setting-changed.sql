-- When was 5208:02 changed: writes with another value than the write before on the same machine.
WITH writes AS (
    SELECT machine, node_name, time, value, unit, capture,
        lag(value) OVER (PARTITION BY machine, node ORDER BY time) AS before
    FROM objects WHERE object = '5208:02' AND origin = 'download'
)
SELECT machine, node_name AS node, strftime(time, '%Y-%m-%d %H:%M:%S') AS time, before, value, unit
FROM writes WHERE value <> before
ORDER BY time;
