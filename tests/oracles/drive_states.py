#!/usr/bin/env python3
"""Compares states of drives with canopen-lens, at each status word of a capture.

    drive_states.py PROGRAM CAPTURE [OPTION…]

PROGRAM is cobscope with these options. Prints the number of equal states, the number of states that only canopen-lens decodes
(it assumes the default mapping for an unknown PDO), and each difference; exits with 1 if there is any.
"""
import csv
import json
import os
import re
import subprocess
import sys
import tempfile

# Its names for states of CiA 402, if they differ.
STATES = {"Not ready": "NOT READY TO SWITCH ON", "Ready": "READY TO SWITCH ON", "Enabled": "OPERATION ENABLED",
          "Quick stop": "QUICK STOP ACTIVE", "Fault reaction": "FAULT REACTION ACTIVE"}
STATE = re.compile(r"(?:Axis (\d) )?state: ([A-Za-z ]+?) \(SW")


def ours(program, capture, options):
    """Changes of each axis: frame and state."""
    command = [program, "decode", "-f", "jsonl", "--filter", "kind == device-state", *options, capture]
    changes = {}
    for line in subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines():
        event = json.loads(line)
        changes.setdefault((event["node"], event["channel"]), []).append((event["frames"][1], event["to"]))
    return changes


def theirs(capture):
    """Frame, node, axis and state of each status word."""
    lens = os.path.join(os.path.dirname(sys.executable), "canopen-lens")
    with tempfile.TemporaryDirectory() as folder:
        table = os.path.join(folder, "lens.csv")
        subprocess.run([lens, capture, "-s", table], capture_output=True, check=True)
        with open(table, encoding="utf-8-sig", newline="") as file:
            for row in csv.reader(file):
                if len(row) > 7 and row[3].startswith("TPDO"):
                    for axis, state in STATE.findall(row[7]):
                        yield int(row[0]), int(row[2]), int(axis or 1), STATES.get(state, state.upper())


def main():
    program, capture, *options = sys.argv[1:]
    changes = ours(program, capture, options)
    equal = alone = different = 0
    for frame, node, axis, state in theirs(capture):
        told = [to for at, to in changes.get((node, axis), []) if at <= frame]
        if not told:
            alone += 1
        elif told[-1] == state:
            equal += 1
        else:
            different += 1
            print(f"frame {frame}, node {node}, axis {axis}: {told[-1]}, canopen-lens {state}")
    print(f"{equal} equal, {alone} not decoded, {different} different")
    return 1 if different else 0


sys.exit(main())
