"""Compares a lake in several engines, each without options: counts, sums, machines, days, times.

    lake_engines.py LAKE [--spark]

--spark also reads it with PySpark, which needs Java.
"""

import math
import sys

# Microseconds of a day: sums of whole times of a large lake exceed 64 bits.
DAY = 86_400_000_000

TABLES = ("captures", "findings", "events", "signals", "objects")


def of_duckdb(lake):
    import duckdb

    connection = duckdb.connect()
    connection.execute("SET TimeZone = 'UTC'")

    def one(sql):
        return connection.execute(sql).fetchall()

    def table(name):
        return f"'{lake}/{name}/**/*.parquet'"

    counts = [one(f"SELECT count(*) FROM {table(name)}")[0][0] for name in TABLES]
    total = one(f"SELECT sum(value) FROM {table('signals')}")[0][0]
    machines = one(f"SELECT machine, count(*) FROM {table('events')} GROUP BY machine ORDER BY machine")
    days = one(f"SELECT CAST(day AS VARCHAR), count(*) FROM {table('events')} GROUP BY day ORDER BY 1")
    times = one(f"SELECT sum(epoch_us(time) % {DAY}) FROM {table('events')}")[0][0]
    return counts, total, [tuple(row) for row in machines], [(day[:10], n) for day, n in days], int(times)


def of_polars(lake):
    import polars

    def table(name):
        return polars.scan_parquet(f"{lake}/{name}", hive_partitioning=True)

    counts = [table(name).select(polars.len()).collect().item() for name in TABLES]
    total = table("signals").select(polars.col("value").sum()).collect().item()

    def groups(column):
        text = polars.col(column).cast(polars.String)
        return table("events").group_by(text).agg(polars.len()).sort(column).collect().rows()

    times = table("events").select((polars.col("time").dt.epoch("us") % DAY).sum()).collect().item()
    return counts, total, groups("machine"), groups("day"), times


def of_arrow(lake):
    import pyarrow.compute as pc
    import pyarrow.dataset as ds

    def table(name):
        return ds.dataset(f"{lake}/{name}", format="parquet", partitioning="hive").to_table()

    counts = [table(name).num_rows for name in TABLES]
    total = pc.sum(table("signals")["value"]).as_py()
    events = table("events")

    def groups(column):
        found = events.group_by(column).aggregate([([], "count_all")]).to_pylist()
        return sorted((str(row[column])[:10] if column == "day" else row[column], row["count_all"]) for row in found)

    micros = pc.cast(events["time"], "int64")
    # pyarrow has no remainder; dividing integers rounds down.
    times = pc.sum(pc.subtract(micros, pc.multiply(pc.divide(micros, DAY), DAY))).as_py()
    return counts, total, groups("machine"), groups("day"), times


def of_pandas(lake):
    import pandas

    def table(name):
        return pandas.read_parquet(f"{lake}/{name}")

    counts = [len(table(name)) for name in TABLES]
    total = table("signals")["value"].sum()
    events = table("events")

    def groups(column):
        found = events[column].astype(str).value_counts()
        return sorted((name, int(count)) for name, count in found.items() if count)

    times = int((events["time"].dropna().astype("int64") % DAY).sum())
    return counts, total, groups("machine"), groups("day"), times


def of_datafusion(lake):
    import datafusion
    import pyarrow as pa

    context = datafusion.SessionContext()
    partitions = [("machine", pa.string()), ("day", pa.string())]
    for name in TABLES:
        context.register_parquet(name, f"{lake}/{name}", table_partition_cols=partitions)

    def rows(sql):
        return [tuple(row.values()) for batch in context.sql(sql).collect() for row in batch.to_pylist()]

    counts = [rows(f"SELECT count(*) FROM {name}")[0][0] for name in TABLES]
    total = rows("SELECT sum(value) FROM signals")[0][0]

    def groups(column):
        found = rows(f"SELECT {column}, count(*) FROM events GROUP BY {column}")
        return sorted((unescaped(name), count) for name, count in found)

    times = rows(f"SELECT sum(arrow_cast(time, 'Int64') % {DAY}) FROM events")[0][0]
    return counts, total, groups("machine"), groups("day"), times


def unescaped(name):
    """DataFusion returns partition values as they are in the path."""
    from urllib.parse import unquote

    return unquote(name)


def of_spark(lake):
    from pyspark.sql import SparkSession

    builder = SparkSession.builder.master("local[2]").config("spark.ui.enabled", "false")
    spark = builder.config("spark.sql.session.timeZone", "UTC").getOrCreate()
    spark.sparkContext.setLogLevel("ERROR")
    for name in TABLES:
        spark.read.parquet(f"{lake}/{name}").createOrReplaceTempView(name)

    def rows(sql):
        return [tuple(row) for row in spark.sql(sql).collect()]

    counts = [rows(f"SELECT count(*) FROM {name}")[0][0] for name in TABLES]
    total = rows("SELECT sum(value) FROM signals")[0][0]
    machines = sorted(rows("SELECT machine, count(*) FROM events GROUP BY machine"))
    days = sorted(rows("SELECT CAST(day AS STRING), count(*) FROM events GROUP BY day"))
    times = rows(f"SELECT sum(unix_micros(time) % {DAY}) FROM events")[0][0]
    return counts, total, machines, days, times


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    lake = sys.argv[1]
    engines = [of_duckdb, of_polars, of_arrow, of_pandas, of_datafusion]
    if "--spark" in sys.argv:
        engines.append(of_spark)
    first = of_duckdb(lake)
    assert all(first[0]) and len(first[2]) > 1, first
    for engine in engines[1:]:
        found = engine(lake)
        for name, theirs, ours in zip(("counts", "sum of values", "machines", "days", "sum of times of day"), found, first):
            is_close = name == "sum of values" and math.isclose(theirs, ours, rel_tol=1e-12)
            if theirs != ours and not is_close:
                sys.exit(f"{engine.__name__}: {name}: {theirs!r}, DuckDB has {ours!r}")
    print(f"{len(engines)} engines: {dict(zip(TABLES, first[0]))}")


if __name__ == "__main__":
    main()
