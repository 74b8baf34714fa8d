"""Simulated time, chance, wire and stations: the parts that all machines share.

All times are whole microseconds of one clock. Chance is drawn with `random.Random.random` only, whose sequence is fixed
for a seed in all versions of Python: a seed always gives the same bytes.
"""
import heapq
import random

SECOND = 1_000_000


def micros(seconds):
    return round(seconds * SECOND)


class Dice:
    """Random choices of one seed."""

    def __init__(self, seed):
        self.source = random.Random(seed)

    def real(self, low=0.0, high=1.0):
        return low + (high - low) * self.source.random()

    def number(self, low, high):
        """A whole number from low to high, both included."""
        return low + int(self.source.random() * (high - low + 1))

    def chance(self, share):
        return self.source.random() < share

    def pick(self, items):
        return items[int(self.source.random() * len(items))]

    def some(self, items, count):
        """`count` different items."""
        left, chosen = list(items), []
        for _ in range(count):
            chosen.append(left.pop(int(self.source.random() * len(left))))
        return chosen

    def data(self, length):
        return bytes(self.number(0, 255) for _ in range(length))


class Clock:
    """Runs actions in the order of their time."""

    def __init__(self):
        self.now, self.number, self.waiting = 0, 0, []

    def after(self, delay, action):
        self.at(self.now + delay, action)

    def at(self, time, action):
        self.number += 1
        heapq.heappush(self.waiting, (max(time, self.now), self.number, action))

    def run(self, end):
        while self.waiting and self.waiting[0][0] <= end:
            self.now, _, action = heapq.heappop(self.waiting)
            action()
        self.now = end


class Frame:
    """A frame on the wire; `time` is its end."""

    __slots__ = ("time", "identifier", "extended", "remote", "error", "data", "sender")

    def __init__(self, identifier, data, extended=False, remote=False, error=False, sender=None):
        self.identifier, self.data, self.extended = identifier, data, extended
        self.remote, self.error, self.sender, self.time = remote, error, sender, 0

    def duration(self, bit_rate):
        """ISO 11898-1: 47 or 67 bits and the data, and about one stuff bit in ten."""
        bits = (67 if self.extended else 47) + 8 * len(self.data)
        return round(bits * 1.1 * SECOND / bit_rate)


# Error frames of SocketCAN (linux/can/error.h): identifier and data.
STUFF_ERROR = (0x088, bytes([0, 0, 0x04, 0, 0, 0, 0, 0]))
FORM_ERROR = (0x088, bytes([0, 0, 0x02, 0x0A, 0, 0, 0, 0]))
RECEIVE_OVERFLOW = (0x004, bytes([0, 0x01, 0, 0, 0, 0, 0, 0]))


class Wire:
    """One bus: of all waiting frames the one with the lowest identifier is sent next."""

    def __init__(self, clock, dice, name, bit_rate):
        self.clock, self.dice, self.name, self.bit_rate = clock, dice, name, bit_rate
        self.waiting, self.is_busy, self.number = [], False, 0
        self.listeners, self.frames = {}, []
        self.disturbed_until, self.disturbance = 0, 0.0

    def listen(self, station, identifier, action):
        """`identifier` None: all frames."""
        self.listeners.setdefault(identifier, []).append((station, action))

    def send(self, station, frame):
        frame.sender = station
        # The base identifier decides first; a standard frame precedes an extended one with the same base.
        base = frame.identifier << 18 if not frame.extended else frame.identifier
        self.number += 1
        heapq.heappush(self.waiting, (base, frame.extended, self.number, frame))
        if not self.is_busy:
            self.is_busy = True
            self.clock.after(0, self.next_frame)

    def next_frame(self):
        while self.waiting:
            frame = heapq.heappop(self.waiting)[3]
            if frame.sender.is_on_bus():
                break
        else:
            self.is_busy = False
            return
        if self.clock.now < self.disturbed_until and self.dice.chance(self.disturbance):
            self.clock.after(frame.duration(self.bit_rate) // 2, lambda: self.destroy(frame))
        else:
            self.clock.after(frame.duration(self.bit_rate), lambda: self.deliver(frame))

    def destroy(self, frame):
        """The frame is destroyed, an error frame follows, and its sender repeats it."""
        self.add_error(*self.dice.pick([STUFF_ERROR, FORM_ERROR]))
        self.send(frame.sender, frame)
        self.next_frame()

    def add_error(self, identifier, data):
        error = Frame(identifier, data, error=True)
        error.time = self.clock.now
        self.frames.append(error)

    def deliver(self, frame):
        frame.time = self.clock.now
        if frame.sender.segment == 0:
            self.frames.append(frame)
        for key in (frame.identifier, None):
            for station, action in self.listeners.get(key, ()):
                if station is not frame.sender and station.is_on_bus() and station.segment == frame.sender.segment:
                    action(frame)
        self.next_frame()


class Station:
    """A controller with its own supply and connector. `segment` 1 is cut off from the recorder."""

    def __init__(self, wire, name):
        self.wire, self.clock, self.dice, self.name = wire, wire.clock, wire.dice, name
        self.is_powered, self.is_bus_off, self.segment = False, False, 0
        self.lateness = 0               # max delay of its cyclic tasks, in µs
        self.epoch = 0                  # counts power-ups: tasks of an earlier one end

    def is_on_bus(self):
        return self.is_powered and not self.is_bus_off

    def send(self, identifier, data, extended=False, remote=False):
        if self.is_on_bus():
            self.wire.send(self, Frame(identifier, bytes(data), extended, remote))

    def send_later(self, delay, identifier, data):
        """Sends unless the station loses its supply first."""
        epoch = self.epoch
        self.clock.after(delay, lambda: epoch == self.epoch and self.send(identifier, data))

    def power_on(self):
        self.is_powered, self.epoch = True, self.epoch + 1
        self.on_power()

    def power_off(self):
        self.is_powered, self.epoch = False, self.epoch + 1

    def on_power(self):
        """Starts tasks after the supply is on."""


class CyclicTask:
    """Runs an action with a period; each run is late by a random part of `jitter` and of the station's lateness."""

    def __init__(self, station, period, action, jitter=100, phase=None):
        self.station, self.action, self.period, self.jitter = station, action, period, jitter
        self.is_stopped, self.epoch = False, station.epoch
        self.next = station.clock.now + (period if phase is None else phase)
        self.plan()

    def plan(self):
        late = self.station.dice.number(0, self.jitter + self.station.lateness)
        self.station.clock.at(self.next + late, self.run)

    def run(self):
        if self.is_stopped or self.epoch != self.station.epoch:
            return
        self.action()
        # A run that is later than a period does not queue up.
        while self.next <= self.station.clock.now - self.period:
            self.next += self.period
        self.next += self.period
        self.plan()

    def stop(self):
        self.is_stopped = True
