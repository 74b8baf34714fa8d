#!/usr/bin/env python3
"""Prints the frames of our CSV, read with Python's csv, in the columns of `frames.py --direction`, then the comment.

    csv_frames.py FILE.csv
"""
import csv
import sys


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    with open(sys.argv[1], newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file, strict=True):
            flags = "".join(letter for letter, on in (
                ("X", row["extended"] == "1" and row["error"] == "0"), ("R", row["remote"] == "1"),
                ("E", row["error"] == "1"), ("F", row["fd"] == "1"), ("B", row["brs"] == "1"),
                ("S", row["esi"] == "1"), ("T", row["direction"] == "tx")) if on)
            print("\t".join((row["time"], row["bus"], row["id"], flags or "-", row["length"], row["data"] or "-",
                             row["comment"].replace("\n", "\\n"))))


main()
