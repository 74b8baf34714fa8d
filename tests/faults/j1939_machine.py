"""Random J1939 and ISOBUS machines, after SAE J1939-21, -71, -73, -81 and ISO 11783: stations, faults, healthy behaviour."""
from bench import SECOND, Clock, CyclicTask, Station, Wire, micros
from slaves import Process
from truth import Fault

GLOBAL = 0xFF
REQUEST, ACKNOWLEDGE, CLAIM, TP_CM, TP_DT, DM1 = 0xEA00, 0xE800, 0xEE00, 0xEC00, 0xEB00, 0xFECA
VT_TO_ECU, ECU_TO_VT, WORKING_SET = 0xE600, 0xE700, 0xFE0D
COMPONENT_IDENTIFICATION = 0xFEEB
# PGN, period in s, priority: J1939-71 and proprietary ones.
GROUPS = [(0xF004, 0.02, 3), (0xF003, 0.05, 3), (0xFEF1, 0.1, 6), (0xFEEE, 1.0, 6), (0xFEEF, 0.5, 6), (0xFEF5, 1.0, 6),
          (0xFEF7, 1.0, 6), (0xFF21, 0.1, 6), (0xFF33, 0.2, 6), (0xFF54, 0.5, 6)]


def identifier(priority, pgn, source, destination=GLOBAL):
    if pgn >> 8 & 0xFF < 0xF0:
        pgn = pgn & 0x3FF00 | destination
    return priority << 26 | pgn << 8 | source


class Ecu(Station):
    """An ECU: address claim, cyclic groups, DM1, transport protocol, answers to requests."""

    def __init__(self, wire, address, dice):
        super().__init__(wire, f"ECU {address:02X}")
        self.address, self.name_field = address, self.name_of(dice)
        self.boot_time = micros(dice.real(0.05, 0.4))
        self.groups, self.processes, self.tasks, self.stopped = [], {}, {}, set()
        self.has_dm1, self.codes, self.is_claimed = dice.chance(0.7), [], False
        self.answers_requests, self.is_stalled = True, False
        self.is_receiving, self.session = True, None
        wire.listen(self, None, self.on_frame)

    @staticmethod
    def name_of(dice):
        name = dice.number(1, 0x1FFFFF) | dice.number(1, 0x7FF) << 21 | dice.number(0, 255) << 40 | dice.pick([0, 2]) << 60
        return name.to_bytes(8, "little")

    def add_group(self, pgn, period, priority):
        self.groups.append((pgn, micros(period), priority))
        self.processes[pgn] = [Process(self.dice, 2, 20_000) for _ in range(2)]

    def on_power(self):
        epoch = self.epoch
        self.is_claimed = False
        self.clock.after(self.boot_time, lambda: epoch == self.epoch and self.claim())

    def claim(self):
        self.send_claim()
        epoch = self.epoch
        self.clock.after(250_000, lambda: epoch == self.epoch and self.begin())

    def send_claim(self):
        self.send(identifier(6, CLAIM, self.address), self.name_field, extended=True)

    def begin(self):
        self.is_claimed = True
        for pgn, period, priority in self.groups:
            self.tasks[pgn] = CyclicTask(self, period, lambda pgn=pgn, priority=priority: self.send_group(pgn, priority),
                                         jitter=800, phase=self.dice.number(0, period))
        if self.has_dm1:
            self.tasks[DM1] = CyclicTask(self, SECOND, self.send_dm1, jitter=2000)

    def send_group(self, pgn, priority):
        if pgn in self.stopped or self.is_stalled:
            return
        first, second = self.processes[pgn]
        now = self.clock.now
        data = bytes([0xFF]) + (first.read(now) + 20_000).to_bytes(2, "little") + (second.read(now) + 20_000).to_bytes(2, "little")
        self.send(identifier(priority, pgn, self.address), data.ljust(8, b"\xff"), extended=True)

    def send_dm1(self):
        if self.is_stalled:
            return
        if not self.codes:
            self.send(identifier(6, DM1, self.address), bytes([0, 0xFF, 0, 0, 0, 0, 0xFF, 0xFF]), extended=True)
            return
        data = bytes([0x04, 0xFF])
        for spn, fmi in self.codes:
            data += bytes([spn & 0xFF, spn >> 8 & 0xFF, (spn >> 16) << 5 | fmi, 1])
        if len(data) <= 8:
            self.send(identifier(6, DM1, self.address), data.ljust(8, b"\xff"), extended=True)
        else:
            self.broadcast(DM1, data)

    def broadcast(self, pgn, data, missing=None):
        """BAM: J1939-21 5.10.3.1, packets 50 to 200 ms apart."""
        packets = (len(data) + 6) // 7
        head = bytes([32]) + len(data).to_bytes(2, "little") + bytes([packets, 0xFF]) + pgn.to_bytes(3, "little")
        self.send(identifier(7, TP_CM, self.address), head, extended=True)
        epoch = self.epoch
        for number in range(packets):
            part = bytes([number + 1]) + data[7 * number:7 * number + 7].ljust(7, b"\xff")
            if missing != number + 1:
                self.clock.after(60_000 * (number + 1), lambda part=part: epoch == self.epoch and self.send(
                    identifier(7, TP_DT, self.address), part, extended=True))

    # Connection mode --------------------------------------------------------------------------------------------------
    def open_session(self, destination, pgn, data):
        packets = (len(data) + 6) // 7
        self.session = (destination, pgn, data)
        head = bytes([16]) + len(data).to_bytes(2, "little") + bytes([packets, 0xFF]) + pgn.to_bytes(3, "little")
        self.send(identifier(7, TP_CM, self.address, destination), head, extended=True)

    def on_frame(self, frame):
        if not frame.extended or not self.is_claimed:
            return
        source, pgn, destination = frame.identifier & 0xFF, frame.identifier >> 8 & 0x3FF00, frame.identifier >> 8 & 0xFF
        if pgn == CLAIM and source == self.address:
            self.on_contention(frame)
        elif pgn == REQUEST and destination in (self.address, GLOBAL):
            self.on_request(source, int.from_bytes(frame.data[:3], "little"), destination)
        elif pgn == TP_CM and destination == self.address:
            self.on_connection(source, frame.data)
        elif pgn == TP_DT and destination == self.address and self.is_receiving:
            self.on_packet(source, frame.data)

    def on_contention(self, frame):
        """J1939-81 4.2.3: the lower NAME keeps the address; the other one has no further address here."""
        if int.from_bytes(frame.data, "little") > int.from_bytes(self.name_field, "little"):
            self.clock.after(3000, self.send_claim)
        else:
            self.is_claimed = False
            for task in self.tasks.values():
                task.stop()
            self.clock.after(20_000, lambda: self.send(identifier(6, CLAIM, 0xFE), self.name_field, extended=True))

    def on_request(self, source, pgn, destination):
        if pgn == CLAIM:
            self.clock.after(self.dice.number(1000, 30_000), self.send_claim)
        elif not self.answers_requests or self.is_stalled:
            return
        elif pgn == COMPONENT_IDENTIFICATION:
            text = f"MAKER*MODEL{self.address:02X}*{int.from_bytes(self.name_field[:3], 'little')}**".encode()
            self.clock.after(20_000, lambda: self.open_session(source, pgn, text))
        elif destination != GLOBAL:     # J1939-21 5.4.4: NACK to a destination-specific request
            data = bytes([1, 0xFF, 0xFF, 0xFF, source]) + pgn.to_bytes(3, "little")
            self.clock.after(20_000, lambda: self.send(identifier(6, ACKNOWLEDGE, self.address), data, extended=True))

    def on_connection(self, source, data):
        control, pgn = data[0], data[5:8]
        if control == 16 and self.is_receiving:
            self.expected, self.packets_left = data[1:3], data[3]
            answer = bytes([17, data[3], 1, 0xFF, 0xFF]) + pgn
            self.clock.after(5000, lambda: self.send(identifier(7, TP_CM, self.address, source), answer, extended=True))
        elif control == 17 and self.session:
            self.send_packets()

    def send_packets(self):
        destination, _pgn, data = self.session
        for number in range((len(data) + 6) // 7):
            part = bytes([number + 1]) + data[7 * number:7 * number + 7].ljust(7, b"\xff")
            self.clock.after(10_000 * (number + 1), lambda part=part: self.send(
                identifier(7, TP_DT, self.address, destination), part, extended=True))
        self.session_pgn = self.session[1]

    def on_packet(self, source, data):
        if data[0] == getattr(self, "packets_left", 0):
            count = data[0]
            done = bytes([19]) + self.expected + bytes([count, 0xFF]) + COMPONENT_IDENTIFICATION.to_bytes(3, "little")
            self.clock.after(5000, lambda: self.send(identifier(7, TP_CM, self.address, source), done, extended=True))


class Terminal(Ecu):
    """A virtual terminal, ISO 11783-6: VT status once per second, answers to the working set."""

    def begin(self):
        super().begin()
        self.tasks["status"] = CyclicTask(self, SECOND, self.send_status, jitter=3000, phase=0)

    def send_status(self):
        if not self.is_stalled:
            self.send(identifier(3, VT_TO_ECU, self.address), bytes([0xFE, 0x80, 0xE8, 3, 0xFF, 0xFF, 0, 0]), extended=True)

    def on_frame(self, frame):
        super().on_frame(frame)
        if frame.extended and frame.identifier >> 8 & 0x3FF00 == ECU_TO_VT and frame.identifier >> 8 & 0xFF == self.address \
                and frame.data[0] in (0xD1, 0xC0) and self.is_claimed and not self.is_stalled:
            answer = bytes([frame.data[0]]) + (bytes([4, 0]) if frame.data[0] == 0xC0 else bytes([0xFF] * 4 + [0]))
            source = frame.identifier & 0xFF
            self.clock.after(30_000, lambda: self.send(identifier(5, VT_TO_ECU, self.address, source),
                                                       answer.ljust(8, b"\xff"), extended=True))


class WorkingSet(Ecu):
    """A working set master, ISO 11783-7: after VT status it announces itself, loads its pool and maintains it."""

    def __init__(self, wire, address, dice, terminal):
        super().__init__(wire, address, dice)
        self.terminal, self.step, self.last_status = terminal, 0, 0

    def on_frame(self, frame):
        super().on_frame(frame)
        if frame.extended and self.is_claimed and frame.identifier >> 8 & 0x3FF00 == VT_TO_ECU \
                and frame.identifier & 0xFF == self.terminal.address:
            if frame.data[0] == 0xFE:
                self.last_status = self.clock.now
                if self.step == 0:
                    self.announce()
            elif frame.data[0] in (0xC0, 0xD1) and frame.identifier >> 8 & 0xFF == self.address:
                self.step += 1
                if self.step == 2:
                    self.to_terminal(bytes([0xD1]) + b"POOL001")

    def begin(self):
        """Announces itself (ISO 11783-7), then waits for the status of the terminal."""
        super().begin()
        self.step = 0
        self.send(identifier(7, WORKING_SET, self.address), bytes([1]).ljust(8, b"\xff"), extended=True)

    def to_terminal(self, data):
        self.send(identifier(5, ECU_TO_VT, self.address, self.terminal.address), data.ljust(8, b"\xff"), extended=True)

    def announce(self):
        self.step = 1
        self.tasks["maintenance"] = CyclicTask(self, SECOND, self.maintain, jitter=2000, phase=100_000)
        epoch = self.epoch
        self.clock.after(300_000, lambda: epoch == self.epoch and self.to_terminal(bytes([0xC0, 0xFF, 0, 4, 0, 0])))

    def maintain(self):
        """ISO 11783-6: without VT status for 3 s the working set starts again."""
        if self.clock.now - self.last_status > 3 * SECOND:
            self.tasks["maintenance"].stop()
            self.step = 0
            return
        self.to_terminal(bytes([0xFF, 0, 4]))


class J1939Machine:
    """Two to five ECUs, half of the machines with a terminal and a working set."""

    family = "j1939"
    settled = 4 * SECOND

    def __init__(self, dice):
        self.dice, self.clock = dice, Clock()
        self.wire = Wire(self.clock, dice, "can0", dice.pick([250_000, 250_000, 500_000]))
        addresses = dice.some([0x00, 0x03, 0x0B, 0x17, 0x21, 0x27, 0x31, 0x80, 0x81], dice.number(2, 4))
        self.ecus = [Ecu(self.wire, address, dice) for address in addresses]
        groups = dice.some(GROUPS, min(len(GROUPS), 2 * len(self.ecus) + 1))
        for number, group in enumerate(groups):
            self.ecus[number % len(self.ecus)].add_group(*group)
        self.terminal = None
        if dice.chance(0.5):
            self.terminal = Terminal(self.wire, 0x26, dice)
            self.ecus += [self.terminal, WorkingSet(self.wire, 0x8A, dice, self.terminal)]
        self.overflows, self.absent, self.late = [], None, None
        self.has_profiles = False

    def power_on(self):
        for ecu in self.ecus:
            is_late = self.late and self.late[0] is ecu and self.clock.now < self.late[1]
            if ecu.address != self.absent and not is_late:
                self.clock.at(self.clock.now + self.dice.number(0, 300_000), ecu.power_on)

    def profiles(self):
        return {}

    def description(self):
        return {"bit_rate": self.wire.bit_rate, "nodes": {f"sa:0x{ecu.address:02X}": type(ecu).__name__ for ecu in self.ecus}}


MODES, TEMPTING = {}, {}


def mode(function):
    MODES[function.__name__.replace("_", "-")] = function
    return function


def tempting(function):
    TEMPTING[function.__name__.replace("_", "-")] = function
    return function


def plain(machine):
    return [ecu for ecu in machine.ecus if ecu.groups]


@mode
def ecu_silent(machine, dice, at):
    """An ECU loses its supply for good."""
    ecu = dice.pick(plain(machine))
    machine.clock.at(at, ecu.power_off)
    return Fault("node", ["node-silent", "node-wire", "node-restart"], at, [ecu.address])


@mode
def ecu_restart(machine, dice, at):
    """A short loss of the supply: the ECU claims its address again."""
    ecu, time = dice.pick(plain(machine)), micros(dice.pick([0.1, 0.5, 2.0]))
    machine.clock.at(at, ecu.power_off)
    machine.clock.at(at + time, ecu.power_on)
    return Fault("node", "node-restart", at, [ecu.address], end=at + time)


@mode
def ecu_wire(machine, dice, at):
    """A loose connector of one ECU: silent, back without a claim."""
    ecu, time = dice.pick(plain(machine)), micros(dice.real(2.5, 4))
    machine.clock.at(at, lambda: setattr(ecu, "segment", 1))
    machine.clock.at(at + time, lambda: setattr(ecu, "segment", 0))
    return Fault("node", ["node-wire", "node-silent"], at, [ecu.address], end=at + time)


@mode
def group_supply(machine, dice, at):
    """Several ECUs lose their common supply."""
    if len(machine.ecus) < 3:
        return None
    group, time = dice.some(machine.ecus, 2), micros(dice.pick([0.5, 2.0]))
    returns = dice.chance(0.5)
    for ecu in group:
        machine.clock.at(at + dice.number(0, 2000), ecu.power_off)
        if returns:
            machine.clock.at(at + time + dice.number(0, 10_000), ecu.power_on)
    modes = ["group-supply"] if returns else ["group-supply", "trunk-interrupted"]
    return Fault("group", modes, at, [ecu.address for ecu in group], end=at + time if returns else None)


@mode
def trunk_interrupted(machine, dice, at):
    """The trunk is interrupted."""
    if len(machine.ecus) < 3:
        return None
    group, time = dice.some(machine.ecus, 2), micros(dice.real(2.5, 5))
    for ecu in group:
        machine.clock.at(at, lambda ecu=ecu: setattr(ecu, "segment", 1))
        machine.clock.at(at + time, lambda ecu=ecu: setattr(ecu, "segment", 0))
    return Fault("wire", "trunk-interrupted", at, [ecu.address for ecu in group], end=at + time)


@mode
def address_contention(machine, dice, at):
    """A second ECU claims an address in use."""
    ecu = dice.pick(plain(machine))
    twin = Ecu(machine.wire, ecu.address, dice)
    for group in ecu.groups[:1]:
        twin.add_group(group[0], group[1] / SECOND, group[2])
    machine.clock.at(at, twin.power_on)
    return Fault("node", "duplicate-node", at, [ecu.address])


@mode
def second_sender(machine, dice, at):
    """A second device sends a group with the same source address, without a claim."""
    ecu = dice.pick(plain(machine))
    pgn, period, priority = dice.pick(ecu.groups)
    other, process = Station(machine.wire, "second sender"), Process(dice, 2, 20_000)
    other.is_powered = True

    def send():
        data = bytes([0xFF]) + (process.read(machine.clock.now) + 20_000).to_bytes(2, "little")
        other.send(identifier(priority, pgn, ecu.address), data.ljust(8, b"\xff"), extended=True)
    machine.clock.at(at, lambda: CyclicTask(other, period, send, jitter=500, phase=period // 3))
    return Fault("node", "duplicate-node", at, [ecu.address])


@mode
def stream_stopped(machine, dice, at):
    """One parameter group is no longer sent."""
    ecu = pick_ecu(machine, dice, 2)
    if not ecu:
        return None
    pgn = dice.pick(ecu.groups)[0]
    machine.clock.at(at, lambda: ecu.stopped.add(pgn))
    return Fault("node", "stream-stopped", at, [ecu.address])


def pick_ecu(machine, dice, groups):
    choice = [ecu for ecu in plain(machine) if len(ecu.groups) >= groups or ecu.has_dm1]
    return dice.pick(choice) if choice else None


@mode
def stream_slower(machine, dice, at):
    """A cyclic group becomes slower."""
    ecu, factor = dice.pick(plain(machine)), dice.pick([4, 8])
    pgn = ecu.groups[0][0]
    machine.clock.at(at, lambda: pgn in ecu.tasks and setattr(ecu.tasks[pgn], "period", ecu.groups[0][1] * factor))
    return Fault("node", "stream-slower", at, [ecu.address], after=6, severity=f"x{factor}")


@mode
def value_frozen(machine, dice, at):
    """The values of a group no longer change."""
    ecu = dice.pick(plain(machine))
    pgn = min(ecu.groups, key=lambda group: group[1])[0]
    for process in ecu.processes[pgn]:
        machine.clock.at(at, lambda process=process: process.freeze(at))
    return Fault("process", "value-frozen", at, [ecu.address], after=6)


@mode
def value_jumps(machine, dice, at):
    """Single values jump to the limit of the range."""
    ecu = dice.pick(plain(machine))
    pgn = min(ecu.groups, key=lambda group: group[1])[0]
    machine.clock.at(at, lambda: setattr(ecu.processes[pgn][0], "jumps", 0.05))
    return Fault("process", "value-jumps", at, [ecu.address], after=8)


@mode
def trouble_code(machine, dice, at):
    """An ECU reports an active fault in DM1."""
    ecu = dice.pick(plain(machine))
    ecu.has_dm1 = True
    codes = [(dice.pick([100, 110, 190, 520_200]), dice.pick([0, 1, 3, 4])) for _ in range(dice.number(1, 3))]
    machine.clock.at(at, lambda: ecu.codes.extend(codes))
    return Fault("node", "device-fault", at, [ecu.address])


@mode
def request_unanswered(machine, dice, at):
    """An ECU answers no requests, its cyclic groups continue."""
    ecu = dice.pick(plain(machine))
    tool = Ecu(machine.wire, 0xF9, dice)
    ecu.answers_requests = False
    machine.clock.at(at - micros(1.5), tool.power_on)
    for number in range(4):
        machine.clock.at(at + number * micros(1.6), lambda: tool.send(
            identifier(6, REQUEST, 0xF9, ecu.address), COMPONENT_IDENTIFICATION.to_bytes(3, "little"), extended=True))
    return Fault("server", "request-unanswered", at, [ecu.address], after=7)


@mode
def session_interrupted(machine, dice, at):
    """The receiver of a multi-packet message does not answer, or packets of a BAM are missing."""
    ecu, other = dice.some(plain(machine), 2)
    if dice.chance(0.5):
        other.is_receiving = False
        for number in range(3):
            machine.clock.at(at + number * 2 * SECOND, lambda: ecu.open_session(other.address, 0xEF00, dice.data(30)))
        return Fault("node", "session-interrupted", at, [other.address, ecu.address], after=6)
    for number in range(3):
        machine.clock.at(at + number * 2 * SECOND, lambda: ecu.broadcast(0xFF70, bytes(40), missing=3))
    return Fault("node", "session-interrupted", at, [ecu.address], after=6)


@mode
def babbling(machine, dice, at):
    """An ECU sends one group at the highest rate."""
    ecu, time = dice.pick(plain(machine)), micros(dice.real(1, 3))

    def send():
        if machine.clock.now < at + time:
            ecu.send(identifier(3, 0xFF66, ecu.address), bytes(8), extended=True)
            machine.clock.after(700, send)
    machine.clock.at(at, send)
    return Fault("node", ["babbling", "bus-overloaded"], at, [ecu.address], end=at + time)


@mode
def bus_disturbed(machine, dice, at):
    """Interference on the wire."""
    share, time = dice.pick([0.2, 0.5]), micros(dice.real(0.5, 3))

    def disturb():
        machine.wire.disturbed_until, machine.wire.disturbance = at + time, share
    machine.clock.at(at, disturb)
    return Fault("wire", "bus-disturbed", at, end=at + time, needs_errors=True)


@mode
def terminal_silent(machine, dice, at):
    """The terminal fails; the working set gives up its session."""
    if not machine.terminal:
        return None
    machine.clock.at(at, machine.terminal.power_off)
    return Fault("node", ["node-silent", "stream-stopped"], at, [machine.terminal.address], after=6)


@mode
def terminal_absent(machine, dice, _at):
    """The working set waits for a terminal that is not there."""
    if not machine.terminal:
        return None
    machine.absent = machine.terminal.address
    return Fault("node", ["node-absent", "not-started"], 2 * SECOND, [machine.terminal.address, 0x8A], from_boot=True, after=8)


@mode
def receive_overflow(machine, dice, at):
    """The adapter of the recorder loses frames and reports it."""
    time = micros(dice.real(0.2, 2.0))
    machine.overflows.append((at, at + time, dice.real(0.3, 0.9)))
    return Fault("recorder", "receive-overflow", at, end=at + time, needs_errors=True)


@tempting
def nothing(machine, dice, at):
    """The machine runs."""


@tempting
def power_cycle(machine, dice, at):
    """The machine is switched off and on."""
    for ecu in machine.ecus:
        machine.clock.at(at + dice.number(0, 30_000), ecu.power_off)
    machine.clock.at(at + micros(dice.real(4, 8)), machine.power_on)


@tempting
def switched_off(machine, dice, at):
    """The machine is switched off: all messages end together."""
    for ecu in machine.ecus:
        machine.clock.at(at + dice.number(0, 10_000), ecu.power_off)


@tempting
def node_late(machine, dice, at):
    """An implement is coupled later: its ECU claims its address then."""
    machine.late = (machine.ecus[-1], at)
    machine.clock.at(at, machine.ecus[-1].power_on)


@tempting
def service_tool(machine, dice, at):
    """A tool asks for all claims and identifications; ECUs may not support them."""
    tool = Ecu(machine.wire, 0xF9, dice)
    machine.clock.at(at, tool.power_on)
    machine.clock.at(at + SECOND, lambda: tool.send(identifier(6, REQUEST, 0xF9), CLAIM.to_bytes(3, "little"), extended=True))
    for number, ecu in enumerate(plain(machine)):
        for step, pgn in enumerate((COMPONENT_IDENTIFICATION, 0xFEE5)):
            machine.clock.at(at + 2 * SECOND + number * SECOND + step * 500_000, lambda ecu=ecu, pgn=pgn: tool.send(
                identifier(6, REQUEST, 0xF9, ecu.address), pgn.to_bytes(3, "little"), extended=True))


@tempting
def standstill(machine, dice, at):
    """The machine stands: values do not change for some seconds."""
    for ecu in plain(machine):
        for processes in ecu.processes.values():
            for process in processes:
                machine.clock.at(at, lambda process=process: process.freeze(at))
                machine.clock.at(at + 4 * SECOND, lambda process=process: setattr(process, "frozen", None))
