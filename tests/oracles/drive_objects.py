#!/usr/bin/env python3
"""Compares the data types of the profile for drives with device files of manufacturers.

    drive_objects.py PROFILE FILE…

PROFILE is decoder/profiles/generic/cia402.toml. Of each EDS or DCF of a drive (1000:00, lower half 402) that canopen-python
reads, the entries from 6000 to 67FF in the profile are compared. Prints one line per difference, and the numbers of compared
files and entries.
"""
import collections
import logging
import sys
import tomllib

import canopen

# CiA 301 table 44.
TYPES = {"INTEGER8": 2, "INTEGER16": 3, "INTEGER32": 4, "UNSIGNED8": 5, "UNSIGNED16": 6, "UNSIGNED32": 7,
         "VISIBLE_STRING": 9}
NAMES = {number: name for name, number in TYPES.items()}


def own(path):
    """The type of each entry of the profile."""
    with open(path, "rb") as file:
        profile = tomllib.load(file)
    for thing in profile["object"]:
        for entry in thing.get("sub", [thing]):
            yield (thing["index"], entry.get("sub", 0)), entry["type"]


def entries(path):
    """Index, sub-index and type of each entry of a drive; empty for other devices."""
    try:
        dictionary = canopen.import_od(path)
        kind = dictionary[0x1000].default
    except Exception:  # Another test covers files that it cannot read.
        return
    if kind is None or kind & 0xFFFF != 402:
        return
    for index, thing in dictionary.items():
        if 0x6000 <= index < 0x6800:
            is_one = isinstance(thing, canopen.objectdictionary.ODVariable)
            for sub, entry in [(0, thing)] if is_one else thing.items():
                yield (index, sub), entry.data_type


def main():
    logging.disable(logging.CRITICAL)
    types = dict(own(sys.argv[1]))
    files = equal = 0
    different = collections.Counter()
    for path in sys.argv[2:]:
        known = [(at, kind) for at, kind in entries(path) if at in types]
        files += bool(known)
        for at, kind in known:
            if TYPES[types[at]] == kind:
                equal += 1
            else:
                different[(at, types[at], NAMES.get(kind, kind))] += 1
    for ((index, sub), ours, theirs), count in sorted(different.items()):
        print(f"{index:04X}:{sub:02X} {ours}, in {count} files {theirs}")
    print(f"{files} files, {equal} equal, {sum(different.values())} different")


main()
