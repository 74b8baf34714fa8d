#!/usr/bin/env python3
"""Decodes the J1939 frames of a candump log by a DBC with cantools.

    dbc_capture.py LOG DBC     prints one line of JSON for each different payload of a group in the DBC

{"frame": N, "pgn": PGN, "values": [[NAME, START, LENGTH, RAW, SCALED, LABEL], …]}; N counts lines from 1, and values
are those of dbc_values.py. Frames shorter than the message and signals that exceed it are omitted.
"""
import json
import re
import sys
import warnings

import dbc_values


def group(identifier):
    """The PGN, without the destination if PF is below 240 (J1939-21 §5.2.3)."""
    number = identifier >> 8 & 0x3FFFF
    return number if number >> 8 & 0xFF >= 240 else number & 0x3FF00


def main():
    warnings.simplefilter("ignore")
    log, dbc = sys.argv[1:]
    messages = {}
    for message in dbc_values.load(dbc_values.read(dbc))[0].messages:
        if message.is_extended_frame:
            messages.setdefault(group(message.frame_id), message)
    readers, seen = {}, set()
    for number, line in enumerate(open(log), 1):
        identifier, data = re.match(r"\(\S+\) \S+ ([0-9A-F]{8})#([0-9A-F]*)$", line.strip()).groups()
        pgn, data = group(int(identifier, 16)), bytes.fromhex(data)
        message = messages.get(pgn)
        if message is None or not 0 < message.length <= len(data) or (pgn, data) in seen:
            continue
        seen.add((pgn, data))
        if pgn not in readers:
            readers[pgn] = [(it, dbc_values.alone(message, it)) for it in message.signals]
        values = [
            [signal.name, signal.start, signal.length, *dbc_values.value(single, data[: message.length])]
            for signal, single in readers[pgn]
            if single is not None
        ]
        print(json.dumps({"frame": number, "pgn": pgn, "values": values}))


if __name__ == "__main__":
    main()
