"""Programs to measure: cobscope, and others that read such captures."""

import os
import shutil
import sys
from dataclasses import dataclass, field

DEVICES = [
    "--node", "2=rexroth-sydfec", "--node", "5=rexroth-ifb-iac", "--node", "1=wandfluh-md2", "--node", "32=danfoss-pve-ci",
]

# Each of these reads a capture with one library, as its users would.
PYTHON_CAN = "import can, sys\nfor message in can.LogReader(sys.argv[1]): pass"
CANOPEN = """
import can, canopen, sys
network = canopen.Network()
for node in range(1, 9):
    network.add_node(node, canopen.objectdictionary.ObjectDictionary())
for message in can.LogReader(sys.argv[1]):
    if not (message.is_error_frame or message.is_remote_frame):
        network.notify(message.arbitration_id, bytearray(message.data), message.timestamp)
"""

CANTOOLS = """
import can, cantools, sys
database = cantools.database.load_file(sys.argv[2])
known = {message.frame_id: message for message in database.messages}
for message in can.LogReader(sys.argv[1]):
    layout = known.get(message.arbitration_id)
    if layout and not (message.is_error_frame or message.is_remote_frame):
        layout.decode(message.data, allow_truncated=True)
"""


@dataclass
class Program:
    """A command and the number of frames that it reads."""

    name: str
    capture: str
    command: list
    frames: int = 1_000_000
    times: list = field(default_factory=list)
    memory: float = 0.0


def ours(root, folder):
    """Commands of cobscope; `folder` contains the inputs."""
    program = os.path.join(root, "target", "dist", "cobscope")

    def decode(name, capture, *options, **more):
        return Program(name, capture, [program, "decode", "--no-findings", *options], **more)

    def convert(to, *options):
        return Program(f"convert to {to}", "normal.log", [program, "convert", "-f", to.split(",")[0], *options])

    rows = [
        decode("candump, -f none", "normal.log", "-f", "none"),
        Program("candump, check: all general rules", "normal.log", [program, "check", "--fail-on", "never"]),
        Program("candump, stats", "normal.log", [program, "stats"]),
        decode("candump, -f jsonl", "normal.log", "-f", "jsonl"),
        decode("candump, -f text", "normal.log"),
        decode("candump, 10,000,000 frames, -f none", "10M.log", "-f", "none", frames=10_000_000),
        Program("the same on one core", "10M.log", ["taskset", "-c", "0", program, "decode", "-f", "none"], 10_000_000),
        decode("pcap, -f none", "normal.pcap", "-f", "none"),
        decode("pcapng, -f none", "normal.pcapng", "-f", "none"),
        decode("J1939, -f none", "engine.log", "-f", "none"),
        Program("J1939, check: all general rules", "engine.log", [program, "check", "--fail-on", "never"]),
        decode("devices with four profiles, -f none", "devices.log", "-f", "none", *DEVICES),
        decode("devices with four profiles, -f jsonl", "devices.log", "-f", "jsonl", *DEVICES),
        Program("devices with four profiles, check", "devices.log", [program, "check", "--fail-on", "never", *DEVICES]),
        decode("known mappings, -f jsonl", "mapped.log", "-f", "jsonl"),
        decode("signals of a DBC, -f jsonl", "normal.log", "-f", "jsonl", "--dbc", os.path.join(folder, "machine.dbc")),
        decode("fault storm, -f none", "storm.log", "-f", "none"),
        decode("gzip, -f none", "normal.log.gz", "-f", "none"),
        decode("zstd, -f none", "normal.log.zst", "-f", "none"),
        convert("candump"), convert("pcapng"), convert("asc"), convert("trc"), convert("csv"),
        convert("mcap, not packed", "--packing", "none"), convert("mcap, lz4", "--packing", "lz4"), convert("mcap, zstd"),
        decode("1,000 frames, -f text", "1k.log", frames=1_000),
        decode("1,000 frames, one profile, -f text", "1k.log", *DEVICES[:2], frames=1_000),
    ]
    for row in rows:
        if row.name.startswith("convert"):
            row.command.append("{capture}")
            row.command.append("-")
    return rows


def peers(folder):
    """Other programs, and the names of the missing ones; `folder` contains the inputs."""
    lens = os.path.join(os.path.dirname(sys.executable), "canopen-lens")
    python = [sys.executable, "-c"]
    rows = [
        Program("wc -l", "normal.log", ["wc", "-l"]),
        Program("gzip -dc", "normal.log.gz", ["gzip", "-dc"]),
        Program("zstd -dc", "normal.log.zst", ["zstd", "-dc"]),
        # A million frames of this machine take more than ten minutes: the time grows quadratically.
        Program("canopen-lens: diagnosis", "100k.log", [lens], frames=100_000),
        Program("tshark: one line per frame, CANopen, pcap", "100k.pcap",
                ["tshark", "-Q", "-d", "can.subdissector,canopen", "-r"], frames=100_000),
        Program("tshark: -T json, CANopen, pcap", "100k.pcap",
                ["tshark", "-Q", "-T", "json", "-d", "can.subdissector,canopen", "-r"], frames=100_000),
        Program("can-utils: log2asc", "normal.log", ["log2asc", "-I", "{capture}", "can0"]),
        Program("python-can: frames only", "100k.log", [*python, PYTHON_CAN, "{capture}"], frames=100_000),
        Program("python-can and canopen", "100k.log", [*python, CANOPEN, "{capture}"], frames=100_000),
        Program("python-can and cantools: signals", "100k.log",
                [*python, CANTOOLS, "{capture}", os.path.join(folder, "machine.dbc")], frames=100_000),
    ]
    missing = [row for row in rows if shutil.which(row.command[0]) is None]
    return [row for row in rows if row not in missing], [row.name for row in missing]
