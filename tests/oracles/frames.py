#!/usr/bin/env python3
"""Prints the frames of a capture as read by python-can, one line per frame.

    frames.py [--direction] CAPTURE

Reads the formats of python-can's LogReader: candump log (.log), ASC, TRC, BLF,
each also with the suffix .gz. Columns, separated by tabs:

    seconds   nine decimals, from the double of python-can (digits after the
              sixth are noise in an epoch time)
    channel   or -
    id        hex, 3 digits standard, 8 digits extended
    flags     letters in this order, or -: X extended, R remote, E error,
              F FD, B bit rate switch, S error state indicator; with --direction
              T sent
    length    bytes of payload; for a remote frame the requested length
    data      hex, or -

Known errors of python-can 4.6.1:
  * candump log: an error frame without the bus-error bit (080) in its class is
    read as an extended data frame without the error flag; with that bit, it is
    read without identifier and data.
  * candump log: `_9` (raw DLC), dotted data and CAN XL lines are errors.
  * ASC: a data frame of length 0 is omitted.
  * the length of `R` without a number is 0.
"""
import sys

try:
    import can
except ImportError:
    sys.exit("frames.py: the library python-can is missing: pip install -r requirements.txt")


def line(msg, tells_direction):
    flags = "".join(letter for letter, on in (
        ("X", msg.is_extended_id and not msg.is_error_frame), ("R", msg.is_remote_frame),
        ("E", msg.is_error_frame), ("F", msg.is_fd), ("B", msg.bitrate_switch),
        ("S", msg.error_state_indicator),
        ("T", tells_direction and not msg.is_rx)) if on)
    digits = 8 if msg.is_extended_id or msg.is_error_frame else 3
    channel = "-" if msg.channel is None else str(msg.channel)
    data = "" if msg.is_remote_frame else bytes(msg.data).hex().upper()
    return "\t".join((f"{msg.timestamp:.9f}", channel, f"{msg.arbitration_id:0{digits}X}",
                      flags or "-", str(msg.dlc), data or "-"))


def main():
    tells_direction = "--direction" in sys.argv[1:]
    paths = [word for word in sys.argv[1:] if word != "--direction"]
    if len(paths) != 1:
        sys.exit(__doc__)
    try:
        with can.LogReader(paths[0]) as reader:
            for msg in reader:
                print(line(msg, tells_direction))
    except BrokenPipeError:
        sys.stderr.close()
    except Exception as error:      # python-can raises many kinds of exceptions for a bad line
        sys.exit(f"frames.py: {paths[0]}: {type(error).__name__}: {error}")


main()
