#!/usr/bin/env python3
"""Writes frames with python-can's BLFWriter and prints them, in the columns of frames.py.

    blf_capture.py OUT.blf COUNT LEVEL CONTAINER

COUNT frames of all kinds on four channels; LEVEL is that of zlib (0 = stored),
CONTAINER the bytes of a container, small enough that objects span containers.
Columns are those of frames.py, with `T` for a sent frame and channel numbers
as in the capture, from 1. The output is not read from the capture: times are
multiples of 1/1024 s, which a double represents exactly.
"""
import random
import sys

try:
    import can
except ImportError:
    sys.exit("blf_capture.py: the library python-can is missing: pip install -r requirements.txt")

START = 1_700_000_000
FD_LENGTHS = [*range(9), 12, 16, 20, 24, 32, 48, 64]


def message(number, noise):
    kind = noise.choice("cccrfffe")
    extended = noise.random() < 0.5
    length = noise.choice(FD_LENGTHS) if kind == "f" else noise.randrange(9)
    return can.Message(
        timestamp=START + number / 1024, channel=noise.randrange(4), dlc=length,
        arbitration_id=noise.getrandbits(29 if extended else 11), is_extended_id=extended,
        is_remote_frame=kind == "r", is_fd=kind == "f", is_error_frame=kind == "e",
        bitrate_switch=kind == "f" and noise.random() < 0.5,
        error_state_indicator=kind == "f" and noise.random() < 0.5,
        is_rx=noise.random() < 0.5, data=None if kind == "r" else noise.randbytes(length), check=True)


def line(number, msg):
    # The writer truncates to nanoseconds.
    nanoseconds = number * 9_765_625 // 10
    time = f"{START + nanoseconds // 10**9}.{nanoseconds % 10**9:09}"
    if msg.is_error_frame:
        # Without a code: a bus error of unknown kind; see linux/can/error.h.
        return f"{time}\t{msg.channel + 1}\t00000088\tE\t8\t0000000000000000"
    flags = "".join(letter for letter, on in (
        ("X", msg.is_extended_id), ("R", msg.is_remote_frame), ("F", msg.is_fd),
        ("B", msg.bitrate_switch), ("S", msg.error_state_indicator), ("T", not msg.is_rx)) if on)
    digits = 8 if msg.is_extended_id else 3
    data = "" if msg.is_remote_frame else bytes(msg.data).hex().upper()
    return "\t".join((time, str(msg.channel + 1), f"{msg.arbitration_id:0{digits}X}", flags or "-",
                      str(msg.dlc), data or "-"))


def main():
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    path, (count, level, container) = sys.argv[1], map(int, sys.argv[2:])
    noise = random.Random(count + level + container)
    with can.BLFWriter(path, compression_level=level, max_container_size=container) as writer:
        for number in range(count):
            msg = message(number, noise)
            writer.on_message_received(msg)
            if number % 100 == 50:
                writer.log_event("a marker", msg.timestamp)
            print(line(number, msg))


main()
