#!/usr/bin/env python3
"""Compares decoded values of NMEA 2000 messages with those of the package `nmea2000`, a separate reader.

    nmea2000_values.py < MESSAGES

Each line of the input is a message: {"pgn": N, "data": HEX, "signals": [{"name", "value", "label"}, …]}. Prints one line of
JSON: {"messages": N, "equal": N, "undefined": N, "differences": {"PGN FIELD": N, …}}; `undefined` counts messages that the
package does not decode. Reserved fields are skipped. Repeated fields have the number of their repetition at the end.
"""
import collections
import json
import logging
import math
import sys

from nmea2000.decoder import NMEA2000Decoder

MISSING = ("not available", "error")


def fields_of(message):
    """Name with the number of its repetition, and field."""
    for field in message.fields:
        if not isinstance(field.value, list):
            yield field.name, field
            continue
        for number, entry in enumerate(field.value, 1):
            for inner in entry.values():
                yield f"{inner.name} {number}", inner


def is_equal(field, signal):
    value, label = signal.get("value"), signal.get("label")
    theirs, raw = field.value, field.raw_value
    if theirs is None and raw is None:
        return value is None or label in MISSING or value == ""
    if theirs is None and isinstance(raw, bytes):
        return str(value).encode() == raw.strip(b" \0\xff@")
    if isinstance(theirs, bytes):
        # Bits that do not start at a byte are a number in cobscope.
        return value in (theirs.hex().upper(), int.from_bytes(theirs, "little"))
    if isinstance(theirs, str):
        text = theirs.strip()
        # A value with a text, a text of the message, bytes, or the bits that are set.
        if text in (label, str(value).strip()) or str(value).lower() == text.lower().replace(" ", "").removeprefix("0x"):
            return True
        if label is not None and {part.strip() for part in label.split(",")} == {part.strip() for part in text.split(",")}:
            return True
    for number in (raw, theirs):
        if isinstance(number, (int, float)) and isinstance(value, (int, float)):
            return math.isclose(number, value, rel_tol=1e-6, abs_tol=1e-6)
    return False


def main():
    logging.disable(logging.CRITICAL)
    decoder = NMEA2000Decoder()
    counts, differences = collections.Counter(), collections.Counter()
    for line in sys.stdin:
        ours = json.loads(line)
        data = [ours["data"][place : place + 2] for place in range(0, len(ours["data"]), 2)]
        text = f"2024-01-01T00:00:00.000Z,6,{ours['pgn']},9,255,{len(data)},{','.join(data)}"
        counts["messages"] += 1
        try:
            message = decoder.decode(text)
        except Exception:  # noqa: BLE001 - the package raises what it likes at a message that it does not know
            message = None
        if message is None:
            counts["undefined"] += 1
            continue
        signals = collections.defaultdict(list)
        for signal in ours["signals"]:
            signals[signal["name"]].append(signal)
        fields = list(fields_of(message))
        # cobscope names a value by its key; the package names all of them "Value".
        known = {name for name, _ in fields}
        keyed = [signal for signal in ours["signals"] if signal["name"] not in known]
        for name, field in fields:
            if field.name.startswith(("Reserved", "Spare")):
                continue
            same = signals.get(name) or (keyed if field.name == "Value" else None)
            signal = same.pop(0) if same else None
            if signal is None and field.value in (None, ""):
                counts["equal"] += 1
            elif signal is not None and is_equal(field, signal):
                counts["equal"] += 1
            else:
                differences[f"{ours['pgn']} {field.name}"] += 1
    print(json.dumps({**counts, "differences": dict(sorted(differences.items()))}))


if __name__ == "__main__":
    main()
