#!/usr/bin/env python3
"""Counts the frames of each CANopen service in a capture, as decoded by tshark.

    canopen_counts.py CAPTURE       prints `name count` lines, sorted

Names: nmt, sync, emcy, time, tpdo1 … rpdo4, sdo-ccs-N and sdo-scs-N (client's
and server's command specifier, the upper three bits), heartbeat, boot-up,
lss-request, lss-response, not-canopen. TSHARK selects another program.

tshark is a second opinion only. Known errors of 4.0.17:
  * It does not track transfers. It decodes segments of a block transfer as
    commands, by their first byte: seqno 1 … 31 counts as ccs/scs 0, 32 … 63 as
    1, and so on, and the last segment of fewer than 32 (81 … 9F) as ccs/scs 4,
    an abort. Compare SDO counts only without block transfers.
  * Remote frames are not decoded as CANopen: guarding requests are
    not-canopen, like extended frames, error frames and FD frames.
  * It knows only the predefined connection set: a PDO or SDO on another COB-ID
    counts as the predefined service of that COB-ID, or as not-canopen.
  * A guarding response counts as a heartbeat, with or without toggle bit.
  * An EMCY frame of length 0 is still an emcy.
"""
import collections
import os
import subprocess
import sys

FIELDS = ("can.id", "can.flags.rtr", "can.flags.xtd", "canopen.cob_id", "canopen.nmt_ctrl.cd",
          "canopen.sdo.ccs", "canopen.sdo.scs", "canopen.nmt_guard.state",
          "canopen.nmt_guard.toggle")
PDO = {3: "tpdo1", 4: "rpdo1", 5: "tpdo2", 6: "rpdo2",
       7: "tpdo3", 8: "rpdo3", 9: "tpdo4", 10: "rpdo4"}


def name(row):
    if not row["canopen.cob_id"]:
        return "not-canopen"
    cob_id = int(row["canopen.cob_id"], 0)
    if row["canopen.nmt_ctrl.cd"]:
        return "nmt"
    if row["canopen.sdo.ccs"]:
        return "sdo-ccs-" + str(int(row["canopen.sdo.ccs"], 0))
    if row["canopen.sdo.scs"]:
        return "sdo-scs-" + str(int(row["canopen.sdo.scs"], 0))
    if row["canopen.nmt_guard.state"]:
        alone = int(row["canopen.nmt_guard.state"], 0) == 0
        turned = row["canopen.nmt_guard.toggle"] not in ("", "0", "0x00")
        return "boot-up" if alone and not turned else "heartbeat"
    if cob_id == 0x7E5:
        return "lss-request"
    if cob_id == 0x7E4:
        return "lss-response"
    if cob_id == 0x080:
        return "sync"
    if cob_id == 0x100:
        return "time"
    if 0x080 < cob_id < 0x100:
        return "emcy"
    return PDO.get(cob_id >> 7, "not-canopen") if cob_id & 0x7F else "not-canopen"


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    program = os.environ.get("TSHARK", "tshark")
    command = [program, "-Q", "-r", sys.argv[1], "-d", "can.subdissector,canopen", "-T", "fields"]
    for field in FIELDS:
        command += ["-e", field]
    try:
        done = subprocess.run(command, capture_output=True, text=True)
    except FileNotFoundError:
        sys.exit(f"canopen_counts.py: {program} is missing: install the package tshark")
    counts = collections.Counter(
        name(dict(zip(FIELDS, text.split("\t")))) for text in done.stdout.splitlines())
    for key in sorted(counts):
        print(key, counts[key])
    complaint = "\n".join(text for text in done.stderr.splitlines()
                          if not text.startswith("Running as user"))
    if done.returncode or complaint:
        sys.exit(f"canopen_counts.py: {complaint[:1000] or 'tshark failed'}")


main()
