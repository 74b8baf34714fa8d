"""Formats measurements as the tables of docs/performance.md."""

import datetime
import os
import re
import statistics
import subprocess

# Targets in millions of frames per second of elapsed time: title, program, target.
RATES = [
    ("candump to events", "candump, 10,000,000 frames, -f none", 50),
    ("candump, checked by all general rules", "candump, check: all general rules", 25),
    ("devices with the signals of four profiles", "devices with four profiles, -f none", 15),
    ("candump to JSON Lines", "candump, -f jsonl", 30),
    ("devices with the signals of four profiles to JSON Lines", "devices with four profiles, -f jsonl", 10),
    ("pcap to events", "pcap, -f none", 80),
]

# Targets of the stages that write MCAP, compared with the `mcap` crate alone.
PACKINGS = [("not packed", 8), ("lz4", 3), ("zstd", 3)]

# Capture formats without compression.
PLAIN = ["candump", "pcapng", "asc", "trc", "csv"]


def figures(row):
    """Elapsed and CPU nanoseconds per frame."""
    return tuple(statistics.median(one[place] for one in row.times) / row.frames * 1e9 for place in (0, 1))


def programs(rows, missing):
    floor = figures(next(row for row in rows if row.name == "wc -l"))[1]
    lines = [
        "| program | ns per frame, elapsed | ns per frame, CPU | M frames/s | CPU relative to `wc -l` | peak memory, MiB |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in rows:
        wall, cpu = figures(row)
        if row.frames == 1_000:
            lines.append(f"| {row.name}: start-up | {wall / 1e3:.1f} ms in total | {cpu / 1e3:.1f} ms | | | {row.memory:.1f} |")
            continue
        lines.append(
            f"| {row.name} | {wall:.1f} | {cpu:.1f} | {1e3 / wall:.2f} | {cpu / floor:.1f} | {row.memory:.1f} |")
    lines += [f"| {name} | not installed | | | | |" for name in missing]
    return "\n".join(lines)


def targets(rows, measured_stages):
    by_name = {row.name: row for row in rows}
    lines = ["| measurement | measured | target | |", "| --- | ---: | ---: | --- |"]

    def add(what, value, target, unit, is_met):
        lines.append(f"| {what} | {value:.1f}{unit} | {target}{unit} | {'met' if is_met else 'not met'} |")

    for what, name, target in RATES:
        if name in by_name:
            rate = 1e3 / figures(by_name[name])[0]
            add(what, rate, target, " M/s", rate >= target)
    rates = {name: 1e3 / ns for name, ns, _ in measured_stages}
    for packing, target in PACKINGS if rates else []:
        rate, alone = rates[f"write MCAP, {packing}"], rates[f"mcap crate alone, {packing}"]
        add(f"stage: frames to MCAP, {packing} (the `mcap` crate alone: {alone:.1f})", rate, target, " M/s", rate >= target)
    converted = [by_name[name] for name in (f"convert to {plain}" for plain in PLAIN) if name in by_name]
    if converted and "candump, -f none" in by_name:
        slowest = max(figures(row)[0] for row in converted)
        share = 100 * figures(by_name["candump, -f none"])[0] / slowest
        add("conversion to the slowest of candump, pcapng, ASC, TRC, CSV, relative to decoding", share, 50, " %", share >= 50)
    if {"gzip -dc", "gzip, -f none"} <= set(by_name):
        share = 100 * figures(by_name["gzip -dc"])[0] / figures(by_name["gzip, -f none"])[0]
        add("gzip, relative to `gzip -dc` alone", share, 90, " %", share >= 90)
    streaming = [row for row in rows if row.name.startswith("candump")]
    if streaming:
        most = max(row.memory for row in streaming)
        add("memory, captures of any length", most, 16, " MiB", most <= 16)
    if "1,000 frames, one profile, -f text" in by_name:
        start = figures(by_name["1,000 frames, one profile, -f text"])[0] / 1e3
        add("start-up with one profile", start, 3, " ms", start <= 3)
    if "the same on one core" in by_name:
        one, two = (figures(by_name[name])[0] for name in ("the same on one core", "candump, 10,000,000 frames, -f none"))
        add("two cores relative to one", one / two, 1.35, "", one / two >= 1.35)
    return "\n".join(lines)


def stages(rows):
    lines = ["| stage, one thread | ns per frame | M frames/s | relative to newline count |", "| --- | ---: | ---: | ---: |"]
    lines += [f"| {name} | {ns:.1f} | {1e3 / ns:.1f} | {floors:.1f} |" for name, ns, floors in rows]
    return "\n".join(lines)


def machine(rounds):
    with open("/proc/cpuinfo") as info:
        model = re.search(r"model name\s*: (.*)", info.read())
    rust = subprocess.run(["rustc", "--version"], stdout=subprocess.PIPE, text=True).stdout.split()[1]
    return (
        f"Measured on {datetime.date.today()}, {rounds} rounds, medians; {os.cpu_count()} cores of "
        f"{model.group(1) if model else 'an unknown processor'}, Linux, Rust {rust}, load average {os.getloadavg()[2]:.1f} over "
        "15 minutes, including this measurement.")


def write(path, sections):
    """Replaces each section between its markers."""
    with open(path, encoding="utf-8") as file:
        text = file.read()
    for name, section in sections.items():
        marked = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        if not marked.search(text):
            raise SystemExit(f"{path}: no section for {name}; expected <!-- {name} --> and <!-- end -->")
        text = marked.sub(lambda match, section=section: f"{match[1]}{section}\n{match[2]}", text)
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)
