#!/usr/bin/env python3
"""Compares Parquet of `decode -f parquet` with the JSON Lines of the same capture, by DuckDB.

    parquet_sums.py LINES.jsonl NAME        NAME.events.parquet and NAME.signals.parquet

Prints the number of signals. Fails with the differences in the schema, in the
events of each kind, their objects, times and nodes, and for each signal of each
group in the number of values, their sums, texts and labels.
"""
import collections
import json
import math
import sys
from decimal import Decimal

import duckdb

TEXT = ("BYTE_ARRAY", "StringType()")
NUMBER = ("INT64", None)
EVENTS = {
    "time": ("INT64", "TimestampType"), "time_ns": NUMBER, "capture": TEXT, "bus": TEXT, "first_frame": NUMBER, "last_frame": NUMBER,
    "kind": TEXT, "protocol": TEXT, "node": NUMBER, "node_name": TEXT, "device": TEXT, "presumed": ("BOOLEAN", None),
    "routine": ("BOOLEAN", None), "text": TEXT, "json": TEXT,
}
SIGNALS = {
    "time": ("INT64", "TimestampType"), "time_ns": NUMBER, "capture": TEXT, "bus": TEXT, "frame": NUMBER, "node": NUMBER, "device": TEXT,
    "group": TEXT, "signal": TEXT, "id": TEXT, "value": ("DOUBLE", None), "text": TEXT, "unit": TEXT, "label": TEXT,
    "raw": NUMBER, "raw_hex": TEXT,
}


def same(what, theirs, ours):
    if theirs != ours:
        sys.exit(f"{what}: Parquet has {theirs!r}, JSON Lines {ours!r}")


def check_schema(path, expected):
    rows = duckdb.execute(
        "SELECT name, type, logical_type FROM parquet_schema(?) WHERE type IS NOT NULL", [path]).fetchall()
    same(f"columns of {path}", [row[0] for row in rows], list(expected))
    for name, physical, logical in rows:
        same(f"type of {name}", physical, expected[name][0])
        wanted = expected[name][1]
        if (logical or "").split("(")[0] != (wanted or "").split("(")[0]:
            sys.exit(f"{name} is {logical}")
        # Timestamps are microseconds in UTC, which every engine reads.
        if logical and logical.startswith("TimestampType"):
            assert "isAdjustedToUTC=1" in logical and "MICROS=MicroSeconds()" in logical, logical
    types = dict(duckdb.execute("SELECT column_name, column_type FROM (DESCRIBE SELECT * FROM read_parquet(?))",
                                [path]).fetchall())
    same("type of time", types["time"], "TIMESTAMP WITH TIME ZONE")
    version = duckdb.execute("SELECT decode(key), decode(value) FROM parquet_kv_metadata(?)", [path]).fetchall()
    assert [key for key, _ in version] == ["cobscope.version"] and version[0][1], version


def is_terminal_control(character):
    """Whether it is a control character or changes the text direction."""
    number = ord(character)
    return number < 32 or 0x7F <= number < 0xA0 or number in (0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A))


def escaped(text):
    """The text with these characters escaped."""
    short = {"\t": "\\t", "\r": "\\r", "\n": "\\n"}
    return text and "".join(short.get(c, f"\\u{{{ord(c):x}}}") if is_terminal_control(c) else c for c in text)


def nanoseconds(seconds):
    return None if seconds is None else int(seconds * 10**9)


def check_events(path, lines):
    rows = duckdb.execute(
        "SELECT time_ns, capture, bus, first_frame, last_frame, kind, protocol, node, node_name, device, presumed,"
        " routine, text, json, epoch_us(time) FROM read_parquet(?)", [path]).fetchall()
    same("events", len(rows), len(lines))
    counts = dict(duckdb.execute("SELECT kind, count(*) FROM read_parquet(?) GROUP BY kind", [path]).fetchall())
    events = [json.loads(line, parse_float=Decimal) for line in lines]
    same("kinds", counts, dict(collections.Counter(event["kind"] for event in events)))
    for row, line, event in zip(rows, lines, events):
        same("object", row[13], line)
        expected = (
            nanoseconds(event["t"]), escaped(event.get("capture")), escaped(event["bus"]), *event["frames"],
            event["kind"], event["protocol"], event.get("node"), escaped(event.get("node_name")), event.get("device"),
            event.get("presumed", False))
        same(f"event {line}", row[:11], expected)
        same(f"time of {line}", row[14], None if row[0] is None else row[0] // 1000)
        text = row[12]
        assert text and not any(is_terminal_control(c) for c in text), text
    return events


def group_of(event, buses):
    if event["kind"] == "pdo":
        group = f"node/{event['node']}/{event['pdo'].lower()}"
    elif event["kind"] in ("j1939-message", "j1939-transfer"):
        group = f"sa/{event['source_address']:02X}/{event['pgn']}"
    else:
        group = f"frame/{event['id']}"
    first = buses.setdefault(event.get("capture"), event["bus"])
    return group if first == event["bus"] else f"{event['bus']}/{group}"


def name_of(signal):
    if signal["name"]:
        return signal["name"]
    return signal["id"].removeprefix("0x") if signal["id"] else f"SPN {signal['spn']}"


class Sums:
    def __init__(self):
        self.count, self.values, self.texts, self.raw = 0, [], [], 0
        self.units, self.labels = set(), collections.Counter()

    def add(self, signal):
        self.count += 1
        self.raw += signal["raw"]
        value = signal["value"]
        if isinstance(value, str):
            self.texts.append(value)
        elif value is not None:
            self.values.append(float(value))
        self.units.add(signal.get("unit"))
        self.labels[signal.get("label")] += 1


def check_signals(path, events):
    expected, buses = collections.defaultdict(Sums), {}
    for event in events:
        for signal in event.get("signals", ()):
            expected[escaped(group_of(event, buses)), escaped(name_of(signal))].add(signal)
    found = duckdb.execute(
        'SELECT "group", signal, count(*), count(value), fsum(value), count(text),'
        " sum(coalesce(raw::HUGEINT, ('0x' || raw_hex)::UBIGINT::HUGEINT)),"
        " list(DISTINCT unit), min(value), max(value) FROM read_parquet(?) GROUP BY ALL", [path]).fetchall()
    labels = collections.defaultdict(collections.Counter)
    for group, name, label, count in duckdb.execute(
            'SELECT "group", signal, label, count(*) FROM read_parquet(?) GROUP BY ALL', [path]).fetchall():
        labels[group, name][label] = count
    same("signals", {(row[0], row[1]) for row in found}, set(expected))
    for group, name, count, values, total, texts, raw, units, least, most in found:
        sums = expected[group, name]
        what = f"{group} {name}"
        same(f"rows of {what}", count, sums.count)
        same(f"values of {what}", values, len(sums.values))
        same(f"texts of {what}", texts, len(sums.texts))
        same(f"raw of {what}", raw, sums.raw)
        same(f"units of {what}", set(units), sums.units)
        same(f"labels of {what}", labels[group, name], sums.labels)
        if sums.values:
            same(f"range of {what}", (least, most), (min(sums.values), max(sums.values)))
            ours = math.fsum(sums.values)
            close = math.isclose(total, ours, rel_tol=1e-9, abs_tol=1e-9 * max(map(abs, sums.values)))
            assert close, f"sum of {what}: Parquet has {total!r}, JSON Lines {ours!r}"
    return len(expected)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    with open(sys.argv[1], encoding="utf-8", newline="\n") as file:
        lines = file.read().split("\n")[:-1]
    events, signals = (f"{sys.argv[2]}.{what}.parquet" for what in ("events", "signals"))
    check_schema(events, EVENTS)
    check_schema(signals, SIGNALS)
    print(check_signals(signals, check_events(events, lines)))


if __name__ == "__main__":
    main()
