#!/usr/bin/env python3
"""Writes a capture as CSV of python-can.

    write_csv.py CAPTURE OUTPUT.csv

Reads the formats of python-can's LogReader. The CSV contains no bus, no direction and no mark of FD frames.
"""
import sys

try:
    import can
except ImportError:
    sys.exit("write_csv.py: the library python-can is missing: pip install -r requirements.txt")


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    with can.LogReader(sys.argv[1]) as reader, can.CSVWriter(sys.argv[2]) as writer:
        for msg in reader:
            writer(msg)


main()
