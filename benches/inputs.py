"""Generates the captures to measure and a DBC of their messages, identical in every run."""

import gzip
import os
import subprocess

# Options of the example `generate_machine`.
GENERATED = {
    "1k.log": ["--frames", "1000"],
    "100k.log": ["--frames", "100000"],
    "100k.pcap": ["--frames", "100000", "--format", "pcap"],
    "normal.log": [],
    "mapped.log": ["--mapping"],
    "storm.log": ["--storm"],
    "engine.log": ["--j1939"],
    "devices.log": ["--devices"],
    "normal.pcap": ["--format", "pcap"],
    "normal.pcapng": ["--format", "pcapng"],
    "10M.log": ["--frames", "10000000"],
}

# PDOs and heartbeat of each node of the machine: base of the identifier, length, signals as
# (name, first bit, bits, signed).
MESSAGES = {
    "TPDO1": (0x180, 8, [("status", 0, 16, False), ("position", 16, 32, True), ("velocity", 48, 16, True)]),
    "TPDO2": (0x280, 4, [("torque", 0, 16, True), ("inputs", 16, 16, False)]),
    "TPDO3": (0x380, 4, [("temperature", 0, 16, False), ("voltage", 16, 16, False)]),
    "TPDO4": (0x480, 8, [("inputs", 0, 32, False), ("temperature", 32, 16, False), ("limits", 48, 16, False)]),
    "RPDO1": (0x200, 6, [("control", 0, 16, False), ("target_position", 16, 32, True)]),
    "RPDO2": (0x300, 4, [("target_velocity", 0, 32, True)]),
    "heartbeat": (0x700, 1, [("state", 0, 7, False)]),
}


def database():
    """The messages as DBC."""
    lines = ['VERSION ""', "NS_ :", "BS_:", "BU_: machine"]
    for node in range(1, 9):
        for name, (base, length, signals) in MESSAGES.items():
            lines.append(f"BO_ {base + node} {name}_{node}: {length} machine")
            lines += [
                f' SG_ {signal} : {first}|{bits}@1{"-" if signed else "+"} (1,0) [0|0] "" machine'
                for signal, first, bits, signed in signals
            ]
    return "\n".join(lines) + "\n"


def generate(root, folder):
    """Generates the missing files; 700 MB in total."""
    os.makedirs(folder, exist_ok=True)
    program = os.path.join(root, "target", "dist", "examples", "generate_machine")
    for name, options in GENERATED.items():
        write(os.path.join(folder, name), lambda out, options=options: subprocess.run(
            [program, *options], stdout=out, stderr=subprocess.DEVNULL, check=True))
    write(os.path.join(folder, "machine.dbc"), lambda out: out.write(database().encode()))
    plain = os.path.join(folder, "normal.log")
    write(plain + ".gz", lambda out: out.write(gzip.compress(open(plain, "rb").read(), 6, mtime=0)))
    write(plain + ".zst", lambda out: subprocess.run(["zstd", "-q", "-c", plain], stdout=out, check=True))


def write(path, make):
    if os.path.exists(path):
        return
    with open(path + ".part", "wb") as out:
        make(out)
    os.rename(path + ".part", path)
