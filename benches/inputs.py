"""The captures that are measured: generated, the same in every run."""

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


def generate(root, folder):
    """Makes what is not there yet; 700 MB in all."""
    os.makedirs(folder, exist_ok=True)
    program = os.path.join(root, "target", "release", "examples", "generate_machine")
    for name, options in GENERATED.items():
        write(os.path.join(folder, name), lambda out, options=options: subprocess.run(
            [program, *options], stdout=out, stderr=subprocess.DEVNULL, check=True))
    plain = os.path.join(folder, "normal.log")
    write(plain + ".gz", lambda out: out.write(gzip.compress(open(plain, "rb").read(), 6, mtime=0)))
    write(plain + ".zst", lambda out: subprocess.run(["zstd", "-q", "-c", plain], stdout=out, check=True))


def write(path, make):
    if os.path.exists(path):
        return
    with open(path + ".part", "wb") as out:
        make(out)
    os.rename(path + ".part", path)
