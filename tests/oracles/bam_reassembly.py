"""Reassembles broadcasts of J1939's transport protocol in a candump log: one line `source pgn hex` per message."""
import re
import sys

announced = {}
for line in open(sys.argv[1]):
    match = re.match(r"\(\S+\) \S+ ([0-9A-F]{8})#([0-9A-F]{16})$", line.strip())
    if not match:
        continue
    identifier, data = int(match[1], 16), bytes.fromhex(match[2])
    source, group = identifier & 0xFF, identifier >> 8 & 0x3FFFF
    if group == 0xECFF and data[0] == 32:
        size, pgn = int.from_bytes(data[1:3], "little"), int.from_bytes(data[5:8], "little")
        announced[source] = (size, pgn, [])
    elif group == 0xEBFF and source in announced:
        size, pgn, packets = announced[source]
        packets.append(data[1:])
        assert data[0] == len(packets), line
        if len(packets) * 7 >= size:
            print(source, pgn, b"".join(packets)[:size].hex().upper())
            del announced[source]
