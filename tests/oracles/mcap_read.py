#!/usr/bin/env python3
"""Compares the output of `decode -f mcap` with that of `decode -f jsonl` for the same capture.

    mcap_read.py FILE.mcap FILE.jsonl

  * every JSON message conforms to the schema of its channel, and those of /log to foxglove.Log
  * every PDO, message or transfer with signals in JSON Lines has a message in the same order, with the same values
  * /events, /findings and objects contain the other events in the same order, with the same text
  * the metadata contain the version, the device of each node, and the source document of its profile
Prints the count of each.
"""
import json
import sys
from collections import Counter, deque

try:
    from jsonschema import Draft202012Validator
    from mcap.reader import make_reader
except ImportError:
    sys.exit("mcap_read.py: mcap or jsonschema is missing: pip install -r requirements.txt")

# https://github.com/foxglove/foxglove-sdk/blob/main/schemas/jsonschema/Log.json
FOXGLOVE_LOG = {
    "type": "object",
    "required": ["timestamp", "level", "message", "name", "file", "line"],
    "properties": {
        "timestamp": {"type": "object", "required": ["sec", "nsec"], "properties": {
            "sec": {"type": "integer", "minimum": 0},
            "nsec": {"type": "integer", "minimum": 0, "maximum": 999_999_999}}},
        "level": {"type": "integer", "enum": [0, 1, 2, 3, 4, 5]},
        "message": {"type": "string"}, "name": {"type": "string"}, "file": {"type": "string"},
        "line": {"type": "integer", "minimum": 0}},
}


def nanoseconds(line):
    """The time of a line as an integer, because a double cannot store nanoseconds since 1970."""
    seconds, fraction = line.split('"t":', 1)[1].split(",", 1)[0].split(".")
    return int(seconds) * 10**9 + int(fraction)


def messages(path):
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            if channel.message_encoding == "json":
                yield schema, channel.topic, message


def check_metadata(path):
    with open(path, "rb") as file:
        tables = {table.name: table.metadata for table in make_reader(file).iter_metadata()}
    assert tables["cobscope"]["version"], tables
    profiles = tables.get("cobscope.profiles", {})
    assert set(tables.get("cobscope.devices", {}).values()) == set(profiles) and all(profiles.values()), tables


def has_time(line):
    return '"t":null' not in line


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    check_metadata(sys.argv[1])
    validators, counts = {}, Counter()
    log = Draft202012Validator(FOXGLOVE_LOG)
    values, records = deque(), deque()
    for schema, topic, message in messages(sys.argv[1]):
        text = message.data.decode()
        content = json.loads(text)
        if schema.id not in validators:
            assert schema.encoding == "jsonschema", schema
            loaded = json.loads(schema.data)
            Draft202012Validator.check_schema(loaded)
            validators[schema.id] = Draft202012Validator(loaded)
        validators[schema.id].validate(content)
        if topic == "/log":
            log.validate(content)
            assert schema.name == "foxglove.Log", schema.name
            stamp = content["timestamp"]
            assert stamp["sec"] * 10**9 + stamp["nsec"] == message.log_time, content
            counts["log"] += 1
        elif schema.name == "cobscope.Event":
            is_finding = content["kind"] in ("finding-opened", "finding-closed")
            is_object = content["kind"] == "object-change"
            assert (topic == "/findings") == is_finding, (topic, content)
            assert topic.endswith("/objects") == is_object, (topic, content)
            records.append((message.log_time, text))
            counts["records"] += 1
        else:
            # The schema of a topic lists all members of its messages.
            assert set(content) <= set(json.loads(schema.data)["properties"]), (topic, content)
            values.append((topic, message.log_time, content))
            counts["values"] += 1
    for line in open(sys.argv[2], encoding="utf-8"):
        line = line.rstrip("\n")
        event = json.loads(line)
        if event["kind"] == "end" or event["kind"] in ("pdo", "j1939-message", "frame") and not event.get("signals"):
            continue
        brings = event["kind"] == "j1939-transfer" and event.get("signals")
        if event["kind"] in ("pdo", "j1939-message", "frame") or brings:
            topic, time, content = values.popleft()
            assert time == nanoseconds(line), (time, line)
            if event["kind"] == "pdo":
                assert event["pdo"].lower() in topic and f"/{event['node']}/" in topic, (topic, line)
            plain = [value for key, value in content.items() if not key.endswith("_label")]
            # A signal without a value has no member.
            expected = [signal["value"] for signal in event["signals"] if signal["value"] is not None]
            assert plain == expected, (content, line)
            labels = [value for key, value in content.items() if key.endswith("_label")]
            assert labels == [signal["label"] for signal in event["signals"] if "label" in signal], (content, line)
        if event["kind"] not in ("pdo", "j1939-message", "frame"):
            time, text = records.popleft()
            assert text == line, (text, line)
            assert not has_time(line) or time == nanoseconds(line), (time, line)
    assert not values and not records, (len(values), len(records), values[:1], records[:1])
    print(" ".join(f"{name} {counts[name]}" for name in ("values", "records", "log")))


main()
