#!/usr/bin/env python3
"""Prints the UDS messages of a capture as reassembled by tshark, one line per message.

    uds_tshark.py [--swap] CAPTURE

    FRAME ID DATA       1-based number of the last frame, its identifier and the message in hexadecimal

--swap: identifiers have the reverse byte order in the capture. tshark decodes every identifier as ISO-TP, so a line
may also belong to an identifier with other contents.
"""
import json
import subprocess
import sys

arguments = sys.argv[1:]
swap = "--swap" in arguments
capture = arguments[-1]
command = ["tshark", "-r", capture, "-d", "can.subdissector,iso15765", "-d", "iso15765.subdissector,uds",
           "-Y", "uds", "-T", "json", "-x"]
if swap:
    command += ["-o", "can.byte_swap:TRUE"]
packets = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
for packet in packets:
    layers = packet["_source"]["layers"]
    number, can_id = layers["frame"]["frame.number"], int(layers["can"]["can.id"])
    print(number, f"{can_id:X}", layers["uds_raw"][0].upper())
