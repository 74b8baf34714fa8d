#!/usr/bin/env python3
"""Reads DBC files and decodes payloads with cantools.

    dbc_values.py FILE…     prints one line of JSON per file

{"file": NAME, "repairs": [TEXT…], "messages": […]}, a message with id (bit 31
for 29 bits), name, length, signals and payloads. A signal has name, start,
length, unit, spn, limits, choices, selects (it is marked as multiplexor) and
mux (name of its multiplexor, the values). A payload has its bytes in hex, the values of all signals in their
order as [raw, scaled, label], also of signals that are not selected, and the
names of the selected ones (null if cantools rejects the payload). Numbers are
text with a prefix for their kind: i:-3, r:5.2.

Values are decoded signal by signal, because cantools cannot decode overlapping
signals. Signals that do not fit into their message are listed without values.

Files that cantools rejects are corrected first; "repairs" lists the changes.
"""
import json
import os
import random
import re
import sys
import warnings

import cantools
from cantools.database.can import Message, Signal

PAYLOADS = 8


def read(path):
    with open(path, "rb") as file:
        data = file.read()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def mend(text, error):
    """The text that cantools accepts, and the list of changes."""
    found = re.search(r"Standard frame id (0x[0-9a-f]+) is more than 11 bits", error)
    if found:
        number = int(found[1], 16)
        return re.sub(rf"\b{number}\b", str(number | 1 << 31), text), f"bit 31 of {number}"
    found = re.search(r"Invalid syntax at line (\d+).*>>!<<(\d\w+)", error)
    if found:
        lines = text.split("\n")
        line = int(found[1]) - 1
        lines[line] = lines[line].replace(found[2], "_" + found[2])
        return "\n".join(lines), f"_ before {found[2]}"
    if re.search(r"Invalid syntax at line \d+, column 1: \">>!<<VAL_ ", error):
        return re.sub(r'(?m)^(VAL_ .*")\s*$', r"\1 ;", text), "; behind VAL_"
    found = re.search(r"unused VAL_ entries in DBC:\s+VAL_ (\d+) (\w+)", error)
    if found:
        return re.sub(rf"(?m)^VAL_ {found[1]} {found[2]} .*$", "", text), f"no VAL_ of {found[2]}"
    return None


def load(text):
    repairs = []
    while True:
        error = None
        for strict in (True, False):
            try:
                return cantools.database.load_string(text, "dbc", strict=strict), repairs
            except cantools.database.UnsupportedDatabaseFormatError as refused:
                error = str(refused)
        mended = mend(text, error)
        if mended is None:
            raise ValueError(error)
        text = mended[0]
        repairs.append(mended[1])


def show(value):
    if isinstance(value, float):
        return "r:" + repr(value)
    return "i:" + str(value)


def alone(message, signal):
    """The message with this signal only, without its multiplexor."""
    single = Signal(
        signal.name, signal.start, signal.length, signal.byte_order, signal.is_signed,
        conversion=signal.conversion,
    )
    try:
        return Message(1, "M", message.length, [single], strict=True)
    except cantools.database.Error:
        return None


def insert(payload, signal, value):
    """Sets the bits of a multiplexor."""
    bits = int.from_bytes(payload, "little" if signal.byte_order == "little_endian" else "big")
    if signal.byte_order == "little_endian":
        shift = signal.start
    else:
        start = 8 * (signal.start // 8) + 7 - signal.start % 8
        shift = 8 * len(payload) - start - signal.length
    mask = ((1 << signal.length) - 1) << shift
    bits = bits & ~mask | value << shift & mask
    return bits.to_bytes(len(payload), "little" if signal.byte_order == "little_endian" else "big")


def payloads(message, rng):
    length = message.length
    yield bytes(length)
    yield b"\xff" * length
    yield bytes(0x80 if place % 2 else 0x01 for place in range(length))
    selected = [signal for signal in message.signals if signal.multiplexer_ids]
    by_name = {signal.name: signal for signal in message.signals}
    for _ in range(PAYLOADS - 3):
        payload = rng.randbytes(length)
        # Outer multiplexors last, because they decide whether the inner ones are used.
        if selected:
            wanted = rng.choice(selected)
            while wanted is not None and wanted.multiplexer_ids:
                by = by_name.get(wanted.multiplexer_signal)
                if by is None or by is wanted:
                    break
                payload = insert(payload, by, rng.choice(wanted.multiplexer_ids))
                wanted = by
        yield payload


def value(single, payload):
    if single is None:
        return None
    name = single.signals[0].name
    raw = single.decode(payload, decode_choices=False, scaling=False)[name]
    scaled = single.decode(payload, decode_choices=False)[name]
    label = single.decode(payload)[name]
    text = None if isinstance(label, (int, float)) else str(label)
    return [show(raw), show(scaled), text]


def describe(signal):
    choices = signal.choices or {}
    return {
        "name": signal.name,
        "start": signal.start,
        "length": signal.length,
        "unit": signal.unit or "",
        "spn": signal.spn or None,
        "limits": None if signal.minimum is None else [show(float(signal.minimum)), show(float(signal.maximum))],
        "choices": {str(key): str(text) for key, text in choices.items()},
        "selects": signal.is_multiplexer,
        "mux": [signal.multiplexer_signal, sorted(signal.multiplexer_ids)] if signal.multiplexer_ids else None,
    }


def decoded(message, payload):
    try:
        return sorted(message.decode(payload, decode_choices=False, allow_truncated=False))
    except Exception:  # any exception of the library is its result
        return None


def entry(message, rng):
    singles = [alone(message, signal) for signal in message.signals]
    return {
        "id": message.frame_id | (1 << 31 if message.is_extended_frame else 0),
        "name": message.name,
        "length": message.length,
        "signals": [describe(signal) for signal in message.signals],
        "payloads": [
            {
                "data": payload.hex(),
                "values": [value(single, payload) for single in singles],
                "names": decoded(message, payload),
            }
            for payload in payloads(message, rng)
        ],
    }


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    warnings.simplefilter("ignore")
    for path in sys.argv[1:]:
        database, repairs = load(read(path))
        rng = random.Random(os.path.basename(path))
        messages = [entry(message, rng) for message in database.messages]
        print(json.dumps({"file": os.path.basename(path), "repairs": repairs, "messages": messages}))


if __name__ == "__main__":
    main()
