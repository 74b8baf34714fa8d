#!/usr/bin/env python3
"""Prints the CAN frames of an MDF4 capture as read by asammdf, or writes such a capture.

    mdf4_frames.py read CAPTURE
    mdf4_frames.py write OUT.mf4 COUNT COMPRESSION
    mdf4_frames.py repack IN.mf4 OUT.mf4 COMPRESSION
    mdf4_frames.py list IN.mf4 OUT.mf4

`read` prints the columns of frames.py, with `T` for a sent frame; seconds are
relative to the start of the capture, because asammdf returns a double. Frames
are sorted by time, and equal times by group. `write` writes COUNT frames of all
kinds with python-can (COMPRESSION 0 none, 1 zlib, 2 zlib of columns) and prints
them in the same way, without reading the file. `repack` writes a capture as MDF 4.3
(COMPRESSION 3 zstd, 4 zstd of columns, 5 LZ4, 6 LZ4 of columns), `list` as
MDF 4.2 with its data in LD and DV blocks, which asammdf 8.8 writes and cannot read.
"""
import random
import sys

try:
    # Imported first, because asammdf imports it too and would otherwise not find itself.
    import can
    import asammdf
    import numpy
except ImportError as error:
    sys.exit(f"mdf4_frames.py: {error.name} is missing: pip install -r requirements.txt")

FD_LENGTHS = [*range(9), 12, 16, 20, 24, 32, 48, 64]
# Received and sent: a bus error of unknown kind; see linux/can/error.h.
ERROR = ("00000088\tE\t8\t0000000000000000", "00000088\tET\t8\t0000800000000000")


def columns(seconds, channel, can_id, extended, remote, fd, brs, esi, tx, length, data):
    flags = "".join(letter for letter, on in (
        ("X", extended), ("R", remote), ("F", fd), ("B", brs), ("S", esi), ("T", tx)) if on)
    return "\t".join((f"{seconds:.6f}", str(channel), f"{can_id:0{8 if extended else 3}X}", flags or "-",
                      str(length), data.hex().upper() or "-"))


def group_lines(mdf, index, name):
    """Times and lines of a group of frames, or None if it has no frames."""
    names = {channel.name for channel in mdf.groups[index].channels}
    if f"{name}.ID" not in names and name != "CAN_ErrorFrame":
        return None

    def values(field, default=0):
        if f"{name}.{field}" not in names:
            return None
        return mdf.get(f"{name}.{field}", group=index, raw=True).samples

    times = mdf.get_master(index)
    fields = {field: values(field) for field in
              ("BusChannel", "ID", "IDE", "DLC", "DataLength", "DataBytes", "Dir", "EDL", "BRS", "ESI")}
    get = lambda field, row, default=0: default if fields[field] is None else int(fields[field][row])
    lines = []
    for row, time in enumerate(times):
        channel, tx = get("BusChannel", row, "can"), get("Dir", row) == 1
        if name == "CAN_ErrorFrame":
            lines.append(f"{time:.6f}\t{channel}\t{ERROR[tx]}")
            continue
        length = get("DLC" if name == "CAN_RemoteFrame" else "DataLength", row)
        data = b"" if fields["DataBytes"] is None else bytes(fields["DataBytes"][row][:length].tobytes())
        lines.append(columns(time, channel, get("ID", row) & 0x1FFFFFFF, get("IDE", row),
                             name == "CAN_RemoteFrame", get("EDL", row), get("EDL", row) and get("BRS", row),
                             get("EDL", row) and get("ESI", row), tx, length, data))
    return times, lines


def read(path):
    mdf = asammdf.MDF(path)
    found = []
    for index in range(len(mdf.groups)):
        names = {channel.name for channel in mdf.groups[index].channels}
        for name in ("CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame"):
            if name in names:
                found.append(group_lines(mdf, index, name))
    times = numpy.concatenate([times for times, _ in found])
    lines = [line for _, lines in found for line in lines]
    for row in numpy.argsort(times, kind="stable"):
        print(lines[row])


def write(path, count, compression):
    noise = random.Random(count + compression)
    with can.MF4Writer(path, compression_level=compression) as writer:
        start = writer._start_time
        for number in range(count):
            kind, extended = noise.choice("dddfre"), noise.random() < 0.5
            fd, error, remote = kind == "f", kind == "e", kind == "r"
            length = noise.choice(FD_LENGTHS) if fd else noise.randrange(9)
            msg = can.Message(
                timestamp=start + number / 1024, channel=noise.randrange(4), dlc=length,
                arbitration_id=noise.getrandbits(29 if extended else 11), is_extended_id=extended,
                is_remote_frame=remote, is_fd=fd, is_error_frame=error, is_rx=noise.random() < 0.5,
                bitrate_switch=fd and noise.random() < 0.5, error_state_indicator=fd and noise.random() < 0.5,
                data=None if remote else noise.randbytes(length), check=True)
            writer.on_message_received(msg)
            tx = not msg.is_rx
            if error:
                print(f"{number / 1024:.6f}\t{msg.channel}\t{ERROR[tx]}")
            else:
                print(columns(number / 1024, msg.channel, msg.arbitration_id, extended, remote, fd,
                              msg.bitrate_switch, msg.error_state_indicator, tx, length, bytes(msg.data)))


def main():
    if len(sys.argv) == 3 and sys.argv[1] == "read":
        read(sys.argv[2])
    elif len(sys.argv) == 5 and sys.argv[1] == "write":
        write(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
    elif len(sys.argv) == 5 and sys.argv[1] == "repack":
        packed = asammdf.MDF(sys.argv[2]).convert("4.30")
        packed.save(sys.argv[3], compression=int(sys.argv[4]), overwrite=True)
    elif len(sys.argv) == 4 and sys.argv[1] == "list":
        listed = asammdf.MDF(sys.argv[2]).convert("4.20")
        for group in listed.groups:
            group.uses_ld = True
        listed.save(sys.argv[3], overwrite=True)
    else:
        sys.exit(__doc__)


main()
