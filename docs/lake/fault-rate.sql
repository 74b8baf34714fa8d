-- Fault rate per machine and week: captures, hours, failed captures, and errors per hour.
WITH weeks AS (
    SELECT machine, date_trunc('week', time) AS week, count(*) AS captures, sum(duration) / 3600 AS hours,
        count(*) FILTER (verdict = 'fail') AS failed
    FROM captures WHERE time IS NOT NULL GROUP BY ALL
), errors AS (
    SELECT machine, date_trunc('week', time) AS week, count(*) AS errors
    FROM findings WHERE severity = 'error' AND standing = 'new' AND member_of IS NULL GROUP BY ALL
)
SELECT machine, CAST(week AS DATE) AS week, captures, failed, coalesce(errors, 0) AS errors,
    round(coalesce(errors, 0) / nullif(hours, 0), 1) AS errors_per_hour
FROM weeks LEFT JOIN errors USING (machine, week)
ORDER BY errors_per_hour DESC, machine, week
LIMIT 10;
