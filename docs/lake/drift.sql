-- Which machine's pump drifts: change of the difference between pressure and set point, in bar per day.
WITH days AS (
    SELECT machine, CAST(time AS DATE) AS date,
        avg(value) FILTER (signal = 'Pressure actual value' AND value > 0)
            - avg(value) FILTER (signal = 'Pressure set point') AS difference
    FROM signals
    WHERE node = 2 AND signal IN ('Pressure actual value', 'Pressure set point')
    GROUP BY ALL
)
SELECT machine, count(*) AS days, round(avg(difference), 1) AS mean,
    round(regr_slope(difference, date - DATE '2024-01-01'), 2) AS bar_per_day
FROM days
GROUP BY machine
HAVING count(*) > 5
ORDER BY abs(bar_per_day) DESC, machine
LIMIT 5;
