#!/usr/bin/env python3
"""Prints the frames of an MCAP file with Foxglove's own reader and a decoder of ROS 2 messages.

    mcap_capture.py FILE.mcap

Columns, separated by tabs: seconds (nine decimals, the log time, which equals the timestamp in the message), bus
(the message's frame_id), topic, id (hex), flags (X extended, R remote, E error, F FD, or -), length, data (hex, or -).
The script also checks the index: every message is in the statistics, and every chunk in the index.
"""
import sys

try:
    from mcap.reader import make_reader
    from mcap.stream_reader import StreamReader
    from mcap.records import Chunk, Message
    from mcap_ros2.decoder import DecoderFactory
except ImportError:
    sys.exit("mcap_capture.py: mcap and mcap-ros2-support are missing: pip install -r requirements.txt")


def check_index(path):
    with open(path, "rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None and summary.statistics is not None, "no summary"
    with open(path, "rb") as file:
        records = list(StreamReader(file, validate_crcs=True, emit_chunks=True).records)
    with open(path, "rb") as file:
        messages = [r for r in StreamReader(file, validate_crcs=True).records if isinstance(r, Message)]
    chunks = [record for record in records if isinstance(record, Chunk)]
    counts = {}
    for message in messages:
        counts[message.channel_id] = counts.get(message.channel_id, 0) + 1
    statistics = summary.statistics
    assert statistics.message_count == len(messages), (statistics, len(messages))
    assert statistics.channel_message_counts == counts, (statistics, counts)
    assert statistics.chunk_count == len(chunks) == len(summary.chunk_indexes), statistics
    assert statistics.message_start_time == min(m.log_time for m in messages)
    assert statistics.message_end_time == max(m.log_time for m in messages)
    for chunk, index in zip(chunks, summary.chunk_indexes):
        assert (chunk.message_start_time, chunk.message_end_time, chunk.compression) == \
            (index.message_start_time, index.message_end_time, index.compression), index


def line(schema, channel, message, frame):
    stamp = frame.header.stamp
    nanoseconds = message.log_time
    assert stamp.sec * 10**9 + stamp.nanosec == nanoseconds == message.publish_time, frame
    is_fd = schema.name == "ros2_socketcan_msgs/msg/FdFrame"
    assert is_fd or schema.name == "can_msgs/msg/Frame", schema.name
    is_remote = not is_fd and frame.is_rtr
    length = frame.len if is_fd else min(frame.dlc, 8)
    flags = "".join(letter for letter, on in (
        ("X", frame.is_extended), ("R", is_remote), ("E", frame.is_error), ("F", is_fd)) if on)
    data = "" if is_remote else bytes(frame.data)[:length].hex().upper()
    digits = 8 if frame.is_extended or frame.is_error else 3
    return "\t".join((f"{nanoseconds // 10**9}.{nanoseconds % 10**9:09}", frame.header.frame_id, channel.topic,
                      f"{frame.id:0{digits}X}", flags or "-", str(length), data or "-"))


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    check_index(sys.argv[1])
    with open(sys.argv[1], "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        # In the order of the file, which also applies to equal times.
        for schema, channel, message, frame in reader.iter_decoded_messages(log_time_order=False):
            print(line(schema, channel, message, frame))


main()
