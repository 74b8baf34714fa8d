#!/usr/bin/env python3
"""CPU time and peak memory of the whole program, beside `wc -l` of the same file.

    cargo build --release && python3 decoder/benches/whole_program.py

Captures are generated into target/bench (about 650 MB, most of it the one of 10,000,000 frames; --short leaves that
out). Rounds go through all commands in turn; medians are printed. CPU time is user + system of the child as the system
accounts it (wait4); peak memory is VmHWM, polled in a run of its own.
"""

import argparse
import os
import statistics
import subprocess
import time

GENERATED = {
    "1k.log": ["--frames", "1000"],
    "normal.log": [],
    "mapped.log": ["--mapping"],
    "storm.log": ["--storm", "--frames", "2000000"],
    "normal.pcap": ["--format", "pcap"],
    "normal.pcapng": ["--format", "pcapng"],
    "devices.log": ["--devices"],
    "10M.log": ["--frames", "10000000"],
}

DEVICES = [
    "--node", "2=rexroth-sydfec", "--node", "5=rexroth-ifb-iac", "--node", "1=wandfluh-md2", "--node", "32=danfoss-pve-ci",
]

COMMANDS = [
    ("newline count (wc -l)", "normal.log", None, 1_000_000),
    ("candump to events", "normal.log", "none", 1_000_000),
    ("candump to JSON Lines", "normal.log", "jsonl", 1_000_000),
    ("candump to text", "normal.log", "text", 1_000_000),
    ("known mappings to JSON Lines", "mapped.log", "jsonl", 1_000_000),
    ("known mappings to text", "mapped.log", "text", 1_000_000),
    ("fault storm to events", "storm.log", "none", 2_000_000),
    ("fault storm to JSON Lines", "storm.log", "jsonl", 2_000_000),
    ("fault storm to text", "storm.log", "text", 2_000_000),
    ("pcap to events", "normal.pcap", "none", 1_000_000),
    ("pcapng to events", "normal.pcapng", "none", 1_000_000),
    ("devices to events, plain", "devices.log", "none", 1_000_000),
    ("devices to events, profiles", "devices.log", "none", 1_000_000, DEVICES),
    ("devices to JSON Lines, plain", "devices.log", "jsonl", 1_000_000),
    ("devices to JSON Lines, profiles", "devices.log", "jsonl", 1_000_000, DEVICES),
    ("candump, converted to candump", "normal.log", "convert candump", 1_000_000),
    ("candump, converted to pcapng", "normal.log", "convert pcapng", 1_000_000),
    ("candump, converted to ASC", "normal.log", "convert asc", 1_000_000),
    ("candump, converted to TRC", "normal.log", "convert trc", 1_000_000),
    ("candump, converted to CSV", "normal.log", "convert csv", 1_000_000),
    ("candump, converted to MCAP", "normal.log", "convert mcap", 1_000_000),
    ("pcapng, converted to candump", "normal.pcapng", "convert candump", 1_000_000),
    ("1,000 frames to text", "1k.log", "text", 1_000),
    ("1,000 frames, one profile", "1k.log", "text", 1_000, DEVICES[:2]),
]


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--rounds", type=int, default=7)
    options.add_argument("--short", action="store_true", help="leave out the capture of 10,000,000 frames")
    options = options.parse_args()
    root = os.path.normpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
    program = os.path.join(root, "target", "release", "cobscope")
    folder = os.path.join(root, "target", "bench")
    generate(root, folder, options.short)
    times = {name: [] for name, *_ in COMMANDS}
    for _ in range(options.rounds):
        for name, capture, output, _, *nodes in COMMANDS:
            times[name].append(cpu_seconds(command(program, folder, capture, output, *nodes)))
    floor = statistics.median(times[COMMANDS[0][0]])
    print(f"{'whole program':<30} {'CPU ms':>8} {'ns/frame':>9} {'M frames/s':>10} {'newline counts':>15}")
    for name, _, _, frames, *_ in COMMANDS:
        seconds = statistics.median(times[name])
        ratio = seconds / frames / (floor / 1_000_000)
        print(f"{name:<30} {seconds * 1e3:8.1f} {seconds / frames * 1e9:9.1f} {frames / seconds / 1e6:10.1f} {ratio:15.1f}")
    for capture in ["normal.log"] + ([] if options.short else ["10M.log"]):
        for output in ["none", "jsonl", "text"]:
            peak = peak_mebibytes(command(program, folder, capture, output))
            print(f"peak memory, {capture} to {output}: {peak:.1f} MiB")


def command(program, folder, capture, output, nodes=()):
    path = os.path.join(folder, capture)
    if output is None:
        return ["wc", "-l", path]
    if output.startswith("convert "):
        return [program, "convert", "-f", output.split()[1], path, "-"]
    return [program, "decode", "-f", output, *nodes, path]


def generate(root, folder, short):
    os.makedirs(folder, exist_ok=True)
    for name, options in GENERATED.items():
        path = os.path.join(folder, name)
        if os.path.exists(path) or (short and name == "10M.log"):
            continue
        with open(path + ".part", "wb") as out:
            cargo = ["cargo", "run", "--quiet", "--release", "-p", "cobscope-decoder", "--example", "generate_machine"]
            subprocess.run([*cargo, "--", *options], cwd=root, stdout=out, check=True)
        os.rename(path + ".part", path)


def cpu_seconds(arguments):
    with open(os.devnull, "wb") as nothing:
        child = subprocess.Popen(arguments, stdout=nothing)
        _, status, usage = os.wait4(child.pid, 0)
    if status != 0:
        raise SystemExit(f"{arguments} failed: {status}")
    return usage.ru_utime + usage.ru_stime


def peak_mebibytes(arguments):
    """VmHWM only grows, so the last look before the end is the peak."""
    peak = 0
    with open(os.devnull, "wb") as nothing:
        child = subprocess.Popen(arguments, stdout=nothing)
        while child.poll() is None:
            try:
                with open(f"/proc/{child.pid}/status") as status:
                    if f"/{os.path.basename(arguments[0])}" in os.readlink(f"/proc/{child.pid}/exe"):
                        peak = max([peak] + [int(line.split()[1]) for line in status if line.startswith("VmHWM")])
            except OSError:
                pass
            time.sleep(0.001)
    return peak / 1024


if __name__ == "__main__":
    main()
