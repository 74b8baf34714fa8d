#!/usr/bin/env python3
"""Reads Parquet of `decode -f parquet` with several engines, without options.

    parquet_engines.py NAME        NAME.events.parquet and NAME.signals.parquet

Fails if DuckDB, Polars, Arrow, pandas or DataFusion finds other numbers of
events and values, another sum of the values, of the bits or of the times, or
other events per minute than the first one. Prints the number of values.
"""
import math
import sys

import datafusion
import duckdb
import pandas
import polars
import pyarrow.compute as compute
import pyarrow.parquet as arrow


def of_duckdb(events, signals):
    values, total, raw = duckdb.execute("SELECT count(*), fsum(value), sum(raw)::BIGINT FROM read_parquet(?)", [signals]).fetchone()
    count, times, sent = duckdb.execute(
        "SELECT count(*), sum(epoch_us(time))::HUGEINT, count(*) FILTER (json LIKE '%\"kind\":\"pdo\"%') FROM read_parquet(?)",
        [events]).fetchone()
    minutes = duckdb.execute(
        "SELECT epoch_us(time_bucket(INTERVAL '1 minute', time)) AS minute, count(*) FROM read_parquet(?)"
        " WHERE time IS NOT NULL GROUP BY minute ORDER BY minute", [events]).fetchall()
    return values, total, raw, count, times, sent, minutes


def of_polars(events, signals):
    values, all_events = polars.read_parquet(signals), polars.read_parquet(events)
    assert all_events.schema["json"] == polars.String, all_events.schema
    minutes = all_events.drop_nulls("time").group_by(polars.col("time").dt.truncate("1m")).len().sort("time")
    return (
        values.height, math.fsum(values["value"].drop_nulls()), values["raw"].sum(), all_events.height,
        sum(all_events["time"].dt.epoch("us").drop_nulls()), all_events["json"].str.contains('"kind":"pdo"', literal=True).sum(),
        [(int(time.timestamp()) * 10**6, count) for time, count in minutes.rows()])


def of_arrow(events, signals):
    values, all_events = arrow.read_table(signals), arrow.read_table(events)
    times = all_events["time"].drop_null()
    minutes = compute.floor_temporal(times, unit="minute").cast("int64").value_counts().to_pylist()
    return (
        values.num_rows, math.fsum(values["value"].drop_null().to_pylist()), compute.sum(values["raw"]).as_py(),
        all_events.num_rows, sum(times.cast("int64").to_pylist()),
        compute.sum(compute.match_substring(all_events["json"], '"kind":"pdo"')).as_py(),
        sorted((row["values"], row["counts"]) for row in minutes))


def of_pandas(events, signals):
    values, all_events = pandas.read_parquet(signals), pandas.read_parquet(events)
    times = all_events["time"].dropna()
    minutes = times.dt.floor("min").value_counts().sort_index()
    micros = lambda stamp: stamp.value // 1000
    return (
        len(values), math.fsum(values["value"].dropna()), int(values["raw"].sum()), len(all_events),
        sum(micros(time) for time in times), int(all_events["json"].str.contains('"kind":"pdo"', regex=False).sum()),
        [(micros(time), count) for time, count in minutes.items()])


def of_datafusion(events, signals):
    context = datafusion.SessionContext()
    context.register_parquet("events", events)
    context.register_parquet("signals", signals)
    rows = lambda query: [tuple(row.values()) for row in context.sql(query).to_pylist()]
    [(values, raw)] = rows("SELECT count(*), sum(raw) FROM signals")
    total = math.fsum(value for value, in rows("SELECT value FROM signals WHERE value IS NOT NULL"))
    [(count, sent)] = rows("SELECT count(*), sum(CASE WHEN json LIKE '%\"kind\":\"pdo\"%' THEN 1 ELSE 0 END) FROM events")
    times = sum(time for time, in rows("SELECT arrow_cast(time, 'Int64') FROM events WHERE time IS NOT NULL"))
    minutes = rows(
        "SELECT arrow_cast(date_trunc('minute', time), 'Int64') AS minute, count(*) FROM events WHERE time IS NOT NULL"
        " GROUP BY date_trunc('minute', time) ORDER BY minute")
    return values, total, raw, count, times, sent, minutes


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    files = [f"{sys.argv[1]}.{what}.parquet" for what in ("events", "signals")]
    engines = [of_duckdb, of_polars, of_arrow, of_pandas, of_datafusion]
    first = of_duckdb(*files)
    assert first[0] and first[3] and first[6], first
    for engine in engines[1:]:
        found = engine(*files)
        names = ("values", "sum of values", "sum of bits", "events", "sum of times", "PDO events", "events per minute")
        for name, theirs, ours in zip(names, found, first):
            if theirs != ours and not (name == "sum of values" and math.isclose(theirs, ours, rel_tol=1e-12)):
                sys.exit(f"{engine.__name__}: {name}: {theirs!r}, DuckDB has {ours!r}")
    print(first[0])


if __name__ == "__main__":
    main()
