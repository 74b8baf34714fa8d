"""Fast packets of NMEA 2000 in a candump log, put together anew: `source pgn hex` a line, in the order of their last
frames. The second argument is the list of groups, nmea2000.toml."""
import re
import sys
import tomllib

groups = tomllib.load(open(sys.argv[2], "rb"))
fast = {group["number"] for group in groups["group"] if group.get("fast")}
fast.update(number for first, last in groups["proprietary_fast"] for number in range(first, last + 1))
packets = {}
for line in open(sys.argv[1]):
    match = re.search(r"\b([0-9A-F]{8})(?:#|\s+\[\d\]\s+)((?:[0-9A-F]{2} ?)+)", line)
    if not match:
        continue
    identifier, data = int(match[1], 16), bytes.fromhex(match[2].replace(" ", ""))
    source, group, destination = identifier & 0xFF, identifier >> 8 & 0x3FFFF, 0xFF
    if identifier >> 16 & 0xFF < 240:
        group, destination = group & 0x3FF00, group & 0xFF
    if group not in fast:
        continue
    key, number = (source, destination, group, data[0] >> 5), data[0] & 0x1F
    if number == 0:
        packets[key] = (data[1], 1, data[2:])
    elif key in packets and packets[key][1] == number:
        packets[key] = (packets[key][0], number + 1, packets[key][2] + data[1:])
    else:
        packets.pop(key, None)
        continue
    length, _, payload = packets[key]
    if len(payload) >= length:
        print(source, group, payload[:length].hex().upper())
        del packets[key]
