"""Diagnostic sessions between a tester and servers, after ISO 14229-1, -2 and ISO 15765-2."""
from bench import SECOND, Clock, CyclicTask, Station, Wire, micros
from truth import Fault

POSITIVE = 0x40


class Link(Station):
    """ISO-TP on a pair of identifiers: segments messages, sends and obeys flow control."""

    def __init__(self, wire, name, sends, receives):
        super().__init__(wire, name)
        self.sends, self.partial, self.pending = sends, {}, None
        self.drops_consecutive = None   # number of a consecutive frame that is never sent
        self.sends_flow_control = True
        self.flow_status = 0
        self.is_powered = True
        for identifier in receives:
            wire.listen(self, identifier, lambda frame, identifier=identifier: self.on_frame(identifier, frame))

    def transmit(self, data, identifier=None):
        identifier = identifier or self.sends
        if len(data) <= 7:
            self.send(identifier, bytes([len(data)]) + data.ljust(7, b"\xcc"))
            return
        self.pending = (data, identifier)
        self.send(identifier, bytes([0x10 | len(data) >> 8, len(data) & 0xFF]) + data[:6])

    def on_frame(self, identifier, frame):
        kind = frame.data[0] >> 4
        if kind == 0:
            self.on_message(bytes(frame.data[1:1 + frame.data[0]]))
        elif kind == 1:
            length = (frame.data[0] & 0x0F) << 8 | frame.data[1]
            self.partial = {"length": length, "data": bytes(frame.data[2:]), "next": 1}
            if self.sends_flow_control:
                self.clock.after(2000, lambda: self.send(self.sends, bytes([0x30 | self.flow_status, 0, 10]).ljust(8, b"\xcc")))
        elif kind == 2 and self.partial:
            if frame.data[0] & 0x0F != self.partial["next"] & 0x0F:
                self.partial = {}
                return
            self.partial["next"] += 1
            self.partial["data"] += bytes(frame.data[1:])
            if len(self.partial["data"]) >= self.partial["length"]:
                message, self.partial = self.partial["data"][:self.partial["length"]], {}
                self.on_message(message)
        elif kind == 3 and self.pending and frame.data[0] & 0x0F == 0:
            (data, target), self.pending = self.pending, None
            rest = data[6:]
            for number in range((len(rest) + 6) // 7):
                part = bytes([0x20 | number + 1 & 0x0F]) + rest[7 * number:7 * number + 7].ljust(7, b"\xcc")
                if self.drops_consecutive != number + 1:
                    self.clock.after(10_000 * (number + 1), lambda part=part: self.send(target, part))

    def on_message(self, data):
        """A complete message."""


class Server(Link):
    """A UDS server: sessions with S3, security access, data identifiers, download."""

    def __init__(self, wire, number, dice):
        super().__init__(wire, f"server {number}", 0x7E8 + number, [0x7E0 + number, 0x7DF])
        self.number, self.session, self.is_unlocked, self.last_request = number, 1, False, 0
        self.answer_time = micros(dice.real(0.003, 0.03))
        self.refuses, self.is_answering, self.pending_forever = {}, True, False
        self.block, self.is_loading = 1, False
        self.data = {0xF190: b"WVWZZZ1KZAW" + b"%06d" % dice.number(0, 999_999), 0xF18C: dice.data(4), 0xF40C: dice.data(2)}

    def on_message(self, data):
        if not self.is_answering or not data:
            return
        if self.session != 1 and self.clock.now - self.last_request > 5 * SECOND:    # ISO 14229-2 table 2: S3 5 s
            self.session, self.is_unlocked, self.is_loading = 1, False, False
        self.last_request = self.clock.now
        answer = self.respond(data)
        if answer:
            epoch = self.epoch
            self.clock.after(self.answer_time, lambda: epoch == self.epoch and self.transmit(answer))

    def refuse(self, service, code):
        return bytes([0x7F, service, code])

    def respond(self, data):
        service = data[0]
        if service == 0x3E:
            return b"" if data[1] & 0x80 else bytes([0x7E, 0])
        if service in self.refuses:
            return self.refuse(service, self.refuses[service])
        if self.pending_forever and service == 0x31:
            return self.refuse(service, 0x78)
        if service == 0x10:
            self.session, self.is_unlocked = data[1], False
            return bytes([0x50, data[1], 0, 50, 1, 0xF4])
        if service == 0x22:
            identifier = data[1] << 8 | data[2]
            value = self.data.get(identifier)
            return bytes([0x62]) + data[1:3] + value if value else self.refuse(service, 0x31)
        if service in (0x2E, 0x27, 0x34, 0x31) and self.session == 1:
            return self.refuse(service, 0x7F)
        if service == 0x27:
            if data[1] == 1:
                return bytes([0x67, 1]) + self.dice.data(4)
            if data[2:] != bytes([1, 2, 3, 4]):
                return self.refuse(service, 0x35)
            self.is_unlocked = True
            return bytes([0x67, 2])
        if service in (0x2E, 0x34, 0x31) and not self.is_unlocked:
            return self.refuse(service, 0x33)
        if service == 0x2E:
            return bytes([0x6E]) + data[1:3]
        if service == 0x31:
            return bytes([0x71]) + data[1:4]
        if service == 0x34:
            self.block, self.is_loading = 1, True
            return bytes([0x74, 0x20, 0, 34])
        if service == 0x36:
            if not self.is_loading:
                return self.refuse(service, 0x24)
            if data[1] != self.block:
                return self.refuse(service, 0x73)
            self.block = self.block % 255 + 1
            return bytes([0x76, data[1]])
        if service == 0x37:
            return bytes([0x77]) if self.is_loading else self.refuse(service, 0x24)
        return self.refuse(service, 0x11)


class Tester(Link):
    """Runs a list of requests per server, each after the response to the last one or its time limit of 1 s."""

    def __init__(self, wire, server, script):
        super().__init__(wire, "tester", 0x7E0 + server.number, [0x7E8 + server.number])
        self.script, self.at, self.number, self.pauses = script, 0, 0, {}
        self.stops_at_failure = True
        self.present = None

    def begin(self):
        self.present = CyclicTask(self, 2 * SECOND, lambda: self.send(0x7DF, bytes([2, 0x3E, 0x80]).ljust(8, b"\xcc")), jitter=2000)
        self.next_request()

    def next_request(self):
        if self.at >= len(self.script):
            self.at = 0                 # the next pass
        self.number += 1
        number = self.number
        self.transmit(self.script[self.at])
        self.clock.after(3 * SECOND, lambda: number == self.number and self.go_on(False))

    def on_message(self, data):
        if data[0] == 0x7F and data[2] == 0x78:
            return
        if data[0] in (self.script[self.at][0] + POSITIVE, 0x7F):
            self.go_on(data[0] != 0x7F)

    def go_on(self, is_good):
        self.number += 1
        pause = self.pauses.get(self.at, micros(self.dice.real(0.05, 0.4)))
        self.at = self.at + 1 if is_good or self.script[self.at][0] == 0x22 else 0
        self.clock.after(pause, self.next_request)


class UdsMachine:
    """One or two servers, each with its own requests."""

    family = "uds"
    settled = 2 * SECOND

    def __init__(self, dice):
        self.dice, self.clock = dice, Clock()
        self.wire = Wire(self.clock, dice, "can0", 500_000)
        self.servers = [Server(self.wire, number, dice) for number in range(dice.number(1, 2))]
        self.testers = [Tester(self.wire, server, self.script(dice)) for server in self.servers]
        self.overflows, self.has_profiles = [], False

    @staticmethod
    def script(dice):
        read = [bytes([0x22, 0xF1, 0x90]), bytes([0x22, 0xF1, 0x8C]), bytes([0x22, 0xF4, 0x0C])]
        extended = [bytes([0x10, 3]), bytes([0x27, 1]), bytes([0x27, 2, 1, 2, 3, 4]), bytes([0x2E, 0xF1, 0x8C]) + dice.data(4),
                    bytes([0x31, 1, 0xFF, 0])]
        load = [bytes([0x10, 2]), bytes([0x27, 1]), bytes([0x27, 2, 1, 2, 3, 4]), bytes([0x34, 0, 0x11, 0, 0x40])] \
            + [bytes([0x36, block]) + dice.data(32) for block in range(1, 6)] + [bytes([0x37])]
        return dice.pick([read + extended, read + load, extended + load])

    def power_on(self):
        for tester in self.testers:
            self.clock.at(self.dice.number(100_000, 900_000), tester.begin)

    def profiles(self):
        return {}

    def description(self):
        return {"bit_rate": 500_000, "nodes": {f"{0x7E0 + server.number:03X}": "Server" for server in self.servers}}


MODES, TEMPTING = {}, {}


def mode(function):
    MODES[function.__name__.replace("_", "-")] = function
    return function


def tempting(function):
    TEMPTING[function.__name__.replace("_", "-")] = function
    return function


def server_fault(mode_name, set_up, component="server", **more):
    """Defines a mode that changes a server at a time."""
    def arm(machine, dice, at):
        server = dice.pick(machine.servers)
        machine.clock.at(at, lambda: set_up(server, dice))
        return Fault(component, mode_name, at, [server.number], after=8, **more)
    MODES[mode_name if isinstance(mode_name, str) else mode_name[0]] = arm


server_fault(["server-silent", "node-silent"], lambda server, dice: server.power_off())
server_fault(["server-stalled", "server-silent"], lambda server, dice: setattr(server, "is_answering", False))
server_fault("security-refused", lambda server, dice: server.refuses.update({0x27: dice.pick([0x35, 0x36, 0x37])}))
server_fault("session-refused", lambda server, dice: server.refuses.update({0x10: dice.pick([0x22, 0x12])}))
server_fault("read-refused", lambda server, dice: server.refuses.update({0x22: dice.pick([0x22, 0x31])}))
server_fault("download-refused", lambda server, dice: server.refuses.update({0x34: dice.pick([0x22, 0x31, 0x70]), 0x2E: 0x22}))
server_fault("segment-missing", lambda server, dice: (server.data.update({0xF18C: bytes(30)}),
                                                     setattr(server, "drops_consecutive", 2)))


@mode
def pending_forever(machine, dice, at):
    """A routine answers response pending and never ends."""
    server, tester = machine.servers[0], machine.testers[0]
    tester.script = tester.script[:3] + [bytes([0x10, 3]), bytes([0x27, 1]), bytes([0x27, 2, 1, 2, 3, 4]), bytes([0x31, 1, 2, 3])]
    machine.clock.at(at, lambda: setattr(server, "pending_forever", True))
    return Fault("server", "pending-forever", at, [0], after=10)


@mode
def session_expired(machine, dice, at):
    """The tester sends no TesterPresent and pauses longer than S3: requests of the session are refused."""
    tester = machine.testers[0]
    tester.script = [bytes([0x10, 3]), bytes([0x27, 1]), bytes([0x27, 2, 1, 2, 3, 4]), bytes([0x2E, 0xF1, 0x8C]) + dice.data(4)]
    machine.testers, machine.servers = machine.testers[:1], machine.servers[:1]
    tester.pauses[2] = micros(5.6)
    machine.clock.at(SECOND, lambda: tester.present.stop())
    return Fault("client", "session-expired", 3 * SECOND, [0], from_boot=True, after=12)


@mode
def wrong_key(machine, dice, at):
    """The tester computes a wrong key."""
    tester = machine.testers[0]
    tester.script = [bytes([0x10, 3]), bytes([0x27, 1]), bytes([0x27, 2]) + bytes([9, 9, 9, 9])]
    return Fault("client", ["wrong-key", "security-refused"], 2 * SECOND, [0], from_boot=True, after=6)


@mode
def block_order(machine, dice, at):
    """The tester repeats a block number of the download."""
    tester = machine.testers[0]
    load = [bytes([0x10, 2]), bytes([0x27, 1]), bytes([0x27, 2, 1, 2, 3, 4]), bytes([0x34, 0, 0x11, 0, 0x40])]
    tester.script = load + [bytes([0x36, 1]) + dice.data(32), bytes([0x36, 3]) + dice.data(32)]
    return Fault("client", "block-order", 2 * SECOND, [0], from_boot=True, after=6)


@mode
def flow_control_missing(machine, dice, at):
    """The receiver sends no flow control: long messages stop after their first frame."""
    tester = machine.testers[0]
    tester.script = [bytes([0x22, 0xF1, 0x90]), bytes([0x22, 0xF1, 0x8C])]
    machine.clock.at(at, lambda: setattr(tester, "sends_flow_control", False))
    return Fault("client", "flow-control-missing", at, [0], after=8)


@mode
def server_restarts(machine, dice, at):
    """The server restarts during the session: the session and its security are gone."""
    server = machine.servers[0]

    def restart():
        server.power_off()
        server.session, server.is_unlocked, server.is_loading = 1, False, False
        machine.clock.after(micros(1.2), server.power_on)
    for number in range(3):
        machine.clock.at(at + number * 4 * SECOND, restart)
    return Fault("server", ["server-restarts", "server-silent"], at, [0], after=9)


@mode
def receive_overflow(machine, dice, at):
    """The adapter of the recorder loses frames and reports it."""
    machine.overflows.append((at, at + micros(1.5), 0.6))
    return Fault("recorder", "receive-overflow", at, end=at + micros(1.5), needs_errors=True)


@tempting
def nothing(machine, dice, at):
    """Sessions pass."""


@tempting
def unsupported_read(machine, dice, at):
    """The tester asks for identifiers that a server does not have, as scan tools do."""
    for tester in machine.testers:
        tester.script = [bytes([0x22, 0xF1, each]) for each in (0x90, 0x87, 0x8C, 0x95)]


@tempting
def pause(machine, dice, at):
    """The tester pauses and opens a session again."""
    machine.testers[0].pauses[len(machine.testers[0].script) - 1] = micros(6)
