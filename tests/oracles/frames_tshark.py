#!/usr/bin/env python3
"""Prints the frames of a capture as read by tshark, in the columns of frames.py.

    frames_tshark.py CAPTURE

Reads the formats of Wireshark: pcap and pcapng (also .gz), candump log, BLF.
TSHARK selects another program than `tshark`.

Seconds are exact. Known errors of tshark 4.0:
  * candump log: the interface name is lost (-).
  * candump log: a fraction of fewer than six digits is read as microseconds
    ((1.2) is 1.000002).
  * candump log: a line that ends with ` R` or ` T`, contains `_9` or is of CAN
    XL ends the reading, or the file is rejected; earlier frames are printed, and
    the exit status is not 0. The same applies to a BOM, dotted data and a
    lower-case `r`.
  * It does not support CAN XL.
"""
import json
import os
import subprocess
import sys


def packets(stream):
    """Yields the objects of tshark's JSON array."""
    part = []
    for text in stream:
        if text == "  {\n":
            part = [text]
        elif text.rstrip(",\n") == "  }":
            part.append("}")
            yield json.loads("".join(part))
            part = []
        elif part:
            part.append(text)


def first(value):
    """The first value of a field; tshark writes a repeated field as a list."""
    return value[0] if isinstance(value, list) else value


def number(value):
    return int(first(value), 0)


def find(tree, name):
    """Finds a field anywhere in the tree of a protocol (flags are in a subtree)."""
    if isinstance(tree, dict):
        if name in tree:
            return tree[name]
        for child in tree.values():
            if (hit := find(child, name)) is not None:
                return hit
    return None


def line(layers):
    fd = "canfd" in layers
    name = "canfd" if fd else "can"
    if name not in layers:
        return None
    tree = layers[name]
    raw = layers[f"{name}_raw"]
    raw = bytes.fromhex(raw[0][0] if isinstance(raw[0], list) else raw[0])
    is_on = lambda field: number(find(tree, field) or "0") != 0
    extended, remote, error = (is_on(f"can.flags.{f}") for f in ("xtd", "rtr", "err"))
    flags = "".join(letter for letter, on in (
        ("X", extended and not error), ("R", remote), ("E", error), ("F", fd),
        ("B", is_on("canfd.flags.brs")), ("S", is_on("canfd.flags.esi"))) if on)
    # struct can_frame: identifier 4 bytes, length, 3 more bytes, data. The identifier
    # of an error frame contains its class bits, which tshark does not print as a number.
    length = number(find(tree, "can.len"))
    can_id = find(tree, "can.id")
    if can_id is None or error:
        # Big-endian in LINKTYPE_CAN_SOCKETCAN, byte order of the host in a candump log.
        order = "little" if "exported_pdu" in layers else "big"
        can_id = int.from_bytes(raw[:4], order) & 0x1FFFFFFF
    else:
        can_id = number(can_id)
    digits = 8 if extended or error else 3
    data = "" if remote else raw[8:8 + length].hex().upper()
    frame = layers["frame"]
    channel = find(frame, "frame.interface_name") or "-"
    if channel == "unknown":        # pcap, which has no names
        channel = "-"
    return "\t".join((first(frame["frame.time_epoch"]), channel, f"{can_id:0{digits}X}",
                      flags or "-", str(length), data or "-"))


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    program = os.environ.get("TSHARK", "tshark")
    command = [program, "-Q", "-r", sys.argv[1], "-T", "json", "-x",
               "-J", "frame can canfd exported_pdu"]
    try:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    except FileNotFoundError:
        sys.exit(f"frames_tshark.py: {program} is missing: install the package tshark")
    for packet in packets(process.stdout):
        text = line(packet["_source"]["layers"])
        if text is not None:
            print(text)
    complaint = "\n".join(text for text in process.stderr.read().splitlines()
                          if not text.startswith("Running as user"))
    if process.wait() or complaint:
        sys.exit(f"frames_tshark.py: {complaint[:1000] or 'tshark failed'}")


main()
