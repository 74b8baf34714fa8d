"""The recorder: lost frames, late start, early end, missing error frames and its clock; candump log output."""
from bench import RECEIVE_OVERFLOW, SECOND, Frame

EPOCH = 1_700_000_000


class Recording:
    """Conditions of a recording. Times are those of the simulation in µs."""

    def __init__(self, dice, start, end):
        self.dice, self.start, self.end = dice, start, end
        self.loss, self.has_errors, self.clock, self.condition = 0.0, True, "exact", "plain"
        self.overflows = []             # (from, to, share): bursts lost by the adapter, each marked by its error frame

    def stored(self, frames, bus="can0"):
        """Frames of the file in order, with timestamps of the recorder's clock."""
        kept, marked = [], set()
        ordered = sorted(frames, key=lambda frame: frame.time)
        for frame in ordered:
            if not self.start <= frame.time <= self.end or frame.error and not self.has_errors:
                continue
            is_lost = self.loss and not frame.error and self.dice.chance(self.loss)
            for number, (first, last, share) in enumerate(self.overflows):
                if first <= frame.time <= last and self.dice.chance(share):
                    is_lost = True
                    if number not in marked and self.has_errors:
                        marked.add(number)
                        note = Frame(*RECEIVE_OVERFLOW, error=True)
                        note.time = frame.time
                        kept.append((self.stamp(note), bus, note))
            if not is_lost:
                kept.append((self.stamp(frame), bus, frame))
        if self.clock != "exact":
            kept.sort(key=lambda entry: entry[0])
        return kept

    def stamp(self, frame):
        """exact; coarse: 1 ms resolution; fast: 100 ppm, delayed by up to 2 ms as by USB packets."""
        if self.clock == "coarse":
            return frame.time // 1000 * 1000
        if self.clock == "usb":
            return round(frame.time * 1.0001) // 1000 * 1000 + 1000
        return frame.time


def candump_line(time, bus, frame):
    if frame.error:
        identifier = f"{0x20000000 | frame.identifier:08X}"
    else:
        identifier = f"{frame.identifier:08X}" if frame.extended else f"{frame.identifier:03X}"
    data = "R" + (str(len(frame.data)) if frame.data else "") if frame.remote else frame.data.hex().upper()
    return f"({EPOCH + time // SECOND}.{time % SECOND:06}) {bus} {identifier}#{data}\n"


def candump_text(entries):
    return "".join(candump_line(*entry) for entry in entries)
