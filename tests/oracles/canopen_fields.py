#!/usr/bin/env python3
"""Compares cobscope's CANopen events of captures with tshark's decoding of their frames, field by field.

    canopen_fields.py PROGRAM CAPTURE…

PROGRAM is cobscope. Both read the same frames: the capture as cobscope writes it to pcapng. Prints one line per
service with its number of compared fields, one line per known difference with its count, and each other difference;
exits with 1 if there is any.

tshark decodes each frame separately and knows only the predefined connection set (4.0.17). These differences are known:
  block          it decodes the segments of a block as commands
  moved          a PDO, EMCY or SDO on a configured identifier
  remote         it does not decode remote frames as CANopen
  transfers      SDO frames outside our transfers: responses without a request, for which cobscope emits no event
  malformed      frames with a wrong length for their service, which tshark decodes partly
  short          SDO frames of fewer than eight bytes, without data in tshark
  reserved       the upper four bits of a time of day, which it decodes as milliseconds (CiA 301 table 16)
"""
import collections
import json
import os
import re
import subprocess
import sys
import tempfile

FIELDS = """frame.number can.id can.len canopen.cob_id canopen.node_id canopen.nmt_ctrl.cd canopen.nmt_ctrl.node_id
canopen.nmt_guard.state canopen.nmt_guard.toggle canopen.sync.counter canopen.time_stamp_ms canopen.time_stamp_days
canopen.em.err_code canopen.em.err_reg canopen.em.err_field canopen.pdo.data.bytes canopen.sdo.ccs canopen.sdo.scs
canopen.sdo.main_idx canopen.sdo.sub_idx canopen.sdo.data.bytes canopen.sdo.abort_code canopen.sdo.n
canopen.lss.cs canopen.lss.addr.vendor canopen.lss.addr.product canopen.lss.addr.revision canopen.lss.addr.serial
canopen.lss.nid canopen.lss.switch.mode""".split()

NMT = {1: "start", 2: "stop", 128: "enter-pre-operational", 129: "reset-node", 130: "reset-communication"}
STATES = {0: "initialising", 4: "stopped", 5: "operational", 127: "pre-operational"}
# CiA 301 table 41: offset of the first identifier of each PDO.
PDOS = {"TPDO1": 0x180, "RPDO1": 0x200, "TPDO2": 0x280, "RPDO2": 0x300,
        "TPDO3": 0x380, "RPDO3": 0x400, "TPDO4": 0x480, "RPDO4": 0x500}


class Comparison:
    """Counts of compared fields, and differences."""

    def __init__(self):
        self.compared = collections.Counter()
        self.known = collections.Counter()
        self.unknown = []

    def same(self, event, field, ours, theirs):
        self.compared[event["kind"]] += 1
        if ours != theirs:
            self.unknown.append(f"{event['kind']} {event['frames']} {field}: ours {ours}, tshark {theirs}")


def number(text):
    return int(text, 0) if text else None


def plain(text):
    return text.replace(":", "").upper()


def frames_of(capture):
    """Fields of each frame that tshark decodes as CANopen, by number."""
    command = ["tshark", "-Q", "-r", capture, "-d", "can.subdissector,canopen", "-T", "fields"]
    for field in FIELDS:
        command += ["-e", field]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    rows = (dict(zip(FIELDS, line.split("\t"))) for line in done.stdout.splitlines())
    return {int(row["frame.number"]): row for row in rows if row["canopen.cob_id"]}


def events_of(program, capture):
    command = [program, "decode", "--no-findings", "--frames", "--protocol", "canopen", "-f", "jsonl", capture]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def one_frame(event, row, out):
    """Compares an event of one frame."""
    kind = event["kind"]
    if kind == "nmt-command":
        out.same(event, "command", event["command"], NMT.get(number(row["canopen.nmt_ctrl.cd"])))
        out.same(event, "target", event["target"], number(row["canopen.nmt_ctrl.node_id"]))
    elif kind in ("boot-up", "heartbeat", "guard-reply"):
        state = number(row["canopen.nmt_guard.state"])
        out.same(event, "node", event["node"], number(row["canopen.node_id"]))
        if kind == "boot-up":
            out.same(event, "state", 0, state)
        else:
            out.same(event, "state", event["state"], STATES.get(state))
        if kind == "guard-reply":
            out.same(event, "toggle", event["toggle"], number(row["canopen.nmt_guard.toggle"]))
    elif kind == "sync":
        out.same(event, "counter", event["counter"], number(row["canopen.sync.counter"]))
    elif kind == "time":
        hours, minutes, seconds = re.search(r"T(\d+):(\d+):([\d.]+)", event["time"]).groups()
        ours = round(((int(hours) * 60 + int(minutes)) * 60 + float(seconds)) * 1000)
        theirs = number(row["canopen.time_stamp_ms"])
        if theirs >= 1 << 28:
            out.known["reserved"] += 1
        out.same(event, "milliseconds", ours, theirs % (1 << 28))
    elif kind == "emcy":
        # tshark reads the code least significant byte first as in CiA 301, like cobscope by default.
        out.same(event, "code", number(event["code"]), number(row["canopen.em.err_code"]))
        out.same(event, "register", number(event.get("register")), number(row["canopen.em.err_reg"]))
        out.same(event, "vendor_data", event.get("vendor_data", ""), plain(row["canopen.em.err_field"]))
    elif kind == "pdo":
        if int(event["cob_id"], 16) != PDOS.get(event["pdo"], 0) + event["node"]:
            out.known["moved"] += 1
        else:
            out.same(event, "data", event["data"], plain(row["canopen.pdo.data.bytes"]))
            out.same(event, "node", event["node"], number(row["canopen.node_id"]))
    elif kind == "lss":
        for ours, theirs in (("vendor_id", "addr.vendor"), ("product_code", "addr.product"),
                             ("revision", "addr.revision"), ("serial_number", "addr.serial"), ("node_id", "nid")):
            if ours in event and row[f"canopen.lss.{theirs}"]:
                out.same(event, ours, number(str(event[ours])), number(row[f"canopen.lss.{theirs}"]))
        out.same(event, "cs", True, row["canopen.lss.cs"] != "")


def transfer(event, rows, out):
    """Compares an SDO transfer with its frames."""
    first, last = event["frames"]
    ids = [int(one, 16) for one in event["cob_ids"]]
    own = [rows[n] for n in range(first, last + 1) if n in rows and number(rows[n]["can.id"]) in ids]
    if event["mode"] == "block":
        out.known["block"] += len(own)
        return own
    if event.get("retries"):
        # tshark lists the data of each repeated request.
        out.known["retry"] += len(own)
        return own
    if not own or own[0]["canopen.sdo.ccs"] + own[0]["canopen.sdo.scs"] == "":
        out.known["moved"] += 1
        return own
    if event.get("cut") in ("start", "both"):
        return own
    if event["object"] is not None:
        index, sub = (int(part, 16) for part in event["object"].removeprefix("0x").split(":"))
        out.same(event, "index", index, number(own[0]["canopen.sdo.main_idx"]))
        out.same(event, "sub", sub, number(own[0]["canopen.sdo.sub_idx"]))
    if event["outcome"] == "aborted":
        out.same(event, "abort", number(event["abort"]["code"]), number(own[-1]["canopen.sdo.abort_code"]))
    elif event["outcome"] == "complete" and any(row["can.len"] != "8" for row in own):
        out.known["short"] += 1
    elif event["outcome"] == "complete":
        data = "".join(data_of(event, row) for row in own if carries(event, row))
        out.same(event, "data", event["data"], data)
    return own


def data_of(event, row):
    """Data without the unused bytes, which tshark counts but also shows."""
    most = 7 if event["mode"] == "segmented" else 4
    return plain(row["canopen.sdo.data.bytes"])[: 2 * (most - (number(row["canopen.sdo.n"]) or 0))]


def carries(event, row):
    """Whether a frame has data of the transfer: segments, or the initiating frame of an expedited transfer."""
    is_upload = event["direction"] == "upload"
    command = number(row["canopen.sdo.scs" if is_upload else "canopen.sdo.ccs"])
    if event["mode"] == "expedited":
        return command == (2 if is_upload else 1)
    return command == 0


def compare(program, capture, out):
    rows = frames_of(capture)
    left = set(rows)
    for event in events_of(program, capture):
        first, last = event["frames"]
        kind = event["kind"]
        if kind == "sdo-transfer":
            left -= {int(row["frame.number"]) for row in transfer(event, rows, out)}
        elif first == last and event["protocol"] == "canopen" or kind == "frame":
            row = rows.get(first)
            if kind == "malformed":
                out.known["malformed"] += 1
            elif row is None and kind in ("guard-request", "pdo", "frame"):
                out.known["remote" if kind != "frame" else "no CANopen to both"] += 1
            elif row is not None:
                one_frame(event, row, out)
            elif kind in ("heartbeat", "guard-reply", "sync", "time", "emcy", "nmt-command", "lss", "boot-up"):
                out.known["moved"] += 1
            left.discard(first)
    for frame in sorted(left):
        is_sdo = rows[frame]["canopen.sdo.ccs"] + rows[frame]["canopen.sdo.scs"] != ""
        if is_sdo:
            out.known["transfers"] += 1
        else:
            out.unknown.append(f"frame {frame}: no event of ours, tshark {rows[frame]}")


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    program, *captures = sys.argv[1:]
    out = Comparison()
    for capture in captures:
        with tempfile.TemporaryDirectory() as folder:
            copy = os.path.join(folder, "capture.pcapng")
            subprocess.run([program, "convert", capture, copy], check=True, stderr=subprocess.DEVNULL)
            before = len(out.unknown)
            compare(program, copy, out)
            name = os.path.basename(capture)
            out.unknown[before:] = [f"{name}: {text}" for text in out.unknown[before:]]
    for kind, count in sorted(out.compared.items()):
        print(f"compared {kind} {count}")
    for reason, count in sorted(out.known.items()):
        print(f"known {reason} {count}")
    print("\n".join(out.unknown[:100]))
    return int(bool(out.unknown))


sys.exit(main())
