"""Kinds of CANopen slaves: device profiles of CiA and the five devices of our profiles, used as their manuals say."""
import math

from bench import SECOND, micros
from canopen import OPERATIONAL, Slave, Tpdo, little


class Process:
    """A physical value: noise, a slow sine and steps, all from the seed of its machine."""

    def __init__(self, dice, size=2, span=None):
        self.dice, self.size = dice, size
        self.span = span or min(30000, (1 << (8 * size - 1)) - 1)
        self.middle = dice.number(-self.span // 3, self.span // 3)
        self.swing = dice.number(self.span // 10, self.span // 3)
        self.period = dice.real(3, 20)
        self.noise = max(1, self.span // 500)
        self.frozen, self.jumps = None, 0.0

    def read(self, now):
        if self.frozen is not None:
            return self.frozen
        if self.jumps and self.dice.chance(self.jumps):
            return (1 << (8 * self.size - 1)) - 1
        turn = 2 * math.pi * now / SECOND / self.period
        return round(self.middle + self.swing * math.sin(turn)) + self.dice.number(-self.noise, self.noise)

    def freeze(self, now):
        self.frozen = self.read(now)


class Drive402(Slave):
    """CiA 402 in profile velocity mode: 6040 and 60FF in RPDO1, 6041 and 606C in TPDO1."""

    DEVICE_TYPE = 0x00020192
    PROFILE = "cia402"
    has_status_word = True

    def __init__(self, wire, node, dice, kind, period):
        super().__init__(wire, node, dice)
        self.status, self.control, self.target, self.actual = 0x250, 0, 0, 0.0
        self.has_voltage, self.is_blocked, self.blocked_since = True, False, None
        self.tpdos.append(Tpdo(1, kind, period, self.status_payload, (0x60410010, 0x606C0020)))
        self.base_objects()
        for index, size, value in ((0x6040, 2, 0), (0x6041, 2, 0x250), (0x6060, 1, 3), (0x6061, 1, 3), (0x60FF, 4, 0), (0x606C, 4, 0)):
            self.add(index, 0, size, value)
        for index, value in ((0x1400, 0x200 + node), (0x1600, 0)):
            self.add(index, 0, 1, 2)
        self.add(0x1400, 1, 4, 0x200 + node)
        self.add(0x1400, 2, 1, 255)
        self.add(0x1600, 1, 4, 0x60400010)
        self.add(0x1600, 2, 4, 0x60FF0020)
        self.add_rpdo(1, 6, self.on_command)

    def on_boot(self):
        self.status, self.control, self.target, self.actual = 0x250, 0, 0, 0.0

    def status_payload(self):
        self.move()
        return little(self.status, 2) + little(round(self.actual), 4)

    def move(self):
        """The speed approaches its target; a blocked axis stands."""
        if self.status & 0x6F != 0x27 or self.is_blocked:
            self.actual = self.actual * 0.5 if abs(self.actual) > 1 else 0.0
        else:
            self.actual += (self.target - self.actual) * 0.4
        if self.is_blocked and self.status & 0x6F == 0x27 and abs(self.target) > 50:
            self.blocked_since = self.blocked_since or self.clock.now
            if self.has_following_error and self.clock.now - self.blocked_since > SECOND:
                self.fault(0x8611, 0x21)
        else:
            self.blocked_since = None

    has_following_error = False

    def fault(self, code, register):
        self.status = 0x218
        self.raise_error(code, register, key="fault")

    def on_command(self, data):
        """CiA 402-2 table 30: transitions of the control word."""
        before, self.control = self.control, int.from_bytes(data[:2], "little")
        self.target = int.from_bytes(data[2:6], "little", signed=True)
        word, state = self.control, self.status & 0x6F
        if self.status & 0x4F == 0x08:
            if word & 0x80 and not before & 0x80 and "fault" in self.errors and not getattr(self, "is_fault_lasting", False):
                self.status = 0x250
                self.clear_error("fault")
            return
        if not word & 0x02:
            self.status = 0x250
        elif state == 0x40 or self.status & 0x4F == 0x40:
            if word & 0x87 == 0x06:
                self.status = 0x231 if self.has_voltage else 0x221
        elif word & 0x87 == 0x06:
            self.status = 0x231 if self.has_voltage else 0x221
        elif word & 0x8F == 0x07 and state in (0x21, 0x27, 0x23):
            if self.has_voltage:        # transition 3 needs the power stage
                self.status = 0x233
        elif word & 0x8F == 0x0F and state == 0x23:
            self.status = 0x237
        elif word & 0x8F == 0x07 and state == 0x27:
            self.status = 0x233

    def next_control(self):
        """Control word of the controller for the status that it received."""
        status = self.status
        if status & 0x4F == 0x08:
            return 0x80
        return {0x21: 0x07, 0x23: 0x0F, 0x27: 0x0F}.get(status & 0x6F, 0x06)


class Module401(Slave):
    """CiA 401: digital inputs on change in TPDO1, analogue inputs in TPDO2, outputs in RPDO1."""

    DEVICE_TYPE = 0x00070191

    def __init__(self, wire, node, dice, kind, period):
        super().__init__(wire, node, dice)
        self.inputs, self.outputs = dice.number(0, 255), 0
        self.bounces = False
        self.next_change = 0
        self.analogue = Process(dice)
        self.tpdos.append(Tpdo(1, "change", dice.pick([0, 500_000, SECOND]), self.input_payload, (0x60000108, 0x60000208)))
        self.tpdos.append(Tpdo(2, kind, period, self.analogue_payload, (0x64010110, 0x64010210)))
        self.base_objects()
        self.add_rpdo(1, 1, self.on_command)

    def input_payload(self):
        if self.clock.now >= self.next_change or self.bounces:
            self.inputs ^= 1 << self.dice.number(0, 7)
            self.next_change = self.clock.now + micros(self.dice.real(0.4, 4))
        return bytes([self.inputs, 0])

    def analogue_payload(self):
        value = self.analogue.read(self.clock.now)
        return little(value, 2) + little(value // 2, 2)

    def on_command(self, data):
        self.outputs = data[0]

    def next_output(self, dice):
        return bytes([1 << dice.number(0, 7)])


class Encoder406(Slave):
    """CiA 406: position in TPDO1."""

    DEVICE_TYPE = 0x00020196

    def __init__(self, wire, node, dice, kind, period):
        super().__init__(wire, node, dice)
        self.position = Process(dice, 4, 2_000_000)
        self.tpdos.append(Tpdo(1, kind, period, self.payload, (0x60040020,)))
        self.base_objects()
        self.add(0x6004, 0, 4, 0)

    def payload(self):
        return little(self.position.read(self.clock.now) + 4_000_000, 4)

    @property
    def analogue(self):
        return self.position


class Generic(Slave):
    """A device without profile: two or three TPDOs of its own."""

    def __init__(self, wire, node, dice, kind, period):
        super().__init__(wire, node, dice)
        self.DEVICE_TYPE = dice.pick([0, 0x00000191])
        self.analogue = Process(dice)
        self.other = Process(dice, 4, 100_000)
        self.tpdos.append(Tpdo(1, kind, period, self.first_payload, (0x20000110, 0x20000220)))
        self.tpdos.append(Tpdo(2, "timer", period * 5 if kind == "timer" else 500_000, self.second_payload, (0x20010120,)))
        self.base_objects()
        self.add(0x2100, 0, 2, 100)
        self.add(0x2101, 0, 2, 5)
        if dice.chance(0.6):
            self.add_rpdo(1, dice.pick([2, 4, 8]), lambda data: None)

    def first_payload(self):
        return little(self.analogue.read(self.clock.now), 2) + little(self.other.read(self.clock.now), 4)

    def second_payload(self):
        return little(self.other.read(self.clock.now), 4)


class Valve408(Slave):
    """State machine of CiA 408: each control word allows one step up; the status word follows in TPDO1."""

    UP = {0x08: (0x01, 0x09), 0x09: (0x03, 0x0B), 0x0B: (0x07, 0x0F)}
    LENGTH = 4

    def __init__(self, wire, node, dice):
        super().__init__(wire, node, dice)
        self.status, self.control, self.target, self.actual = 0x08, 0, 0, 0
        self.has_voltage, self.is_blocked = True, False
        self.tpdos.append(Tpdo(1, "answer", 0, self.payload))
        self.add_objects()
        self.add_rpdo(1, self.LENGTH, self.on_command)

    def on_boot(self):
        self.status, self.control, self.actual = 0x08, 0, 0

    def on_command(self, data):
        before, self.control = self.control, int.from_bytes(data[:2], "little")
        self.target = int.from_bytes(data[2:4], "little", signed=True)
        self.status = self.next_status(self.control & ~before)
        self.actual = self.target if self.status == 0x0F and not self.is_blocked else 0
        self.clock.after(self.answer_time, lambda: self.send_tpdo(self.tpdos[0]))

    def next_status(self, rising):
        if not self.status & 0x08:
            can_leave = rising & 0x08 and not getattr(self, "is_fault_lasting", False)
            if can_leave and self.errors:
                self.clear_error(next(iter(self.errors)))
            return self.status | 0x08 if can_leave else self.status
        if not self.has_voltage:
            return 0x08
        needed, following = self.UP.get(self.status, (0x100, self.status))
        if self.control & needed == needed:
            return following
        for state, bit, lower in ((0x0F, 0x04, 0x0B), (0x0B, 0x02, 0x09), (0x09, 0x01, 0x08)):
            if self.status == state and not self.control & bit:
                return lower
        return self.status

    def fault(self, code, register):
        self.status &= 0x07
        self.raise_error(code, register)
        self.send_tpdo(self.tpdos[0])

    def next_control(self):
        if not self.status & 0x08:
            return 0x08 if self.control & 0x08 == 0 else 0x00
        return {0x08: 0x09, 0x09: 0x0B}.get(self.status, 0x0F)


class Md2(Valve408):
    """Wandfluh MD2, revision 3: amplifier with one channel used (4.5.2, 5.4)."""

    DEVICE_TYPE = 0x80000198
    PROFILE = "wandfluh-md2:amplifier"

    def add_objects(self):
        self.identity[0] = 0x14D
        self.tpdos[0].entries = (0x60410010,)
        self.base_objects()
        for index, size, value in ((0x100C, 2, 0), (0x100D, 1, 0), (0x6040, 2, 0), (0x6041, 2, 8), (0x6042, 1, 1), (0x6043, 1, 1)):
            self.add(index, 0, size, value)

    def payload(self):
        return little(self.status, 2)


class Pve(Valve408):
    """Danfoss PVEA-CI Series 6: boot-up, then EMCY 0000; EMCY 8003 and FAULT HOLD without set points."""

    DEVICE_TYPE = 0x00000198
    PROFILE = "danfoss-pve-ci:pvea"

    def add_objects(self):
        self.identity[:2] = [0x01000019, 0x53360000]
        self.tpdos[0].entries = (0x60410010, 0x63010110)
        self.base_objects()
        for index, size, value in ((0x6040, 2, 0), (0x6041, 2, 8), (0x1028, 1, 1)):
            self.add(index, 0, size, value)
        self.add(0x1028, 1, 4, 0x80000000)

    def payload(self):
        return little(self.status, 2) + little(self.actual, 2)

    def on_boot(self):
        super().on_boot()
        self.send_later(1000, 0x80 + self.node, bytes(8))

    def on_output_timeout(self):
        if self.status == 0x0F:
            self.status = 0x03
            self.raise_error(0x8003, 0x91, b"\x01\x00")
            self.send_tpdo(self.tpdos[0])

    def next_status(self, rising):
        if self.status == 0x03:
            if self.control == 0x0B and rising & 0x08:
                self.clear_error(0x8003)
                return 0x0B
            return 0x03
        return super().next_status(rising)

    def next_control(self):
        if self.status == 0x03:
            return 0x0B if self.control == 0x03 else 0x03
        return super().next_control()


class Ifb(Valve408):
    """Rexroth IFB/IAC (RE 29015-01-Z): set point and pressure limit in RPDO1, guarding with 100C and 100D."""

    DEVICE_TYPE = 0x198
    PROFILE = "rexroth-ifb-iac"
    LENGTH = 6

    def add_objects(self):
        self.base_objects()
        self.add(0x100C, 0, 2, 500)
        self.add(0x100D, 0, 1, 3)
        for index, size, value in ((0x4200, 1, self.node), (0x4201, 1, 7), (0x6042, 1, 1), (0x6043, 1, 0xFD)):
            self.add(index, 0, size, value)
        del self.kept[(0x1017, 0)]

    def next_status(self, rising):
        """12.3: D, H and M of the control word act together."""
        if not self.status & 0x08 and not rising & 0x08:
            return self.status
        return 0x08 | (self.control & 0x07) if self.has_voltage else 0x08

    def payload(self):
        return little(self.status, 2) + little(self.actual, 2) + little(self.actual, 2)


class Vpcd(Slave):
    """Rexroth VT-VPCD (RE 30028-02-Z): TPDO1 by event timer, commands in RPDO1; values written are volatile (3.3)."""

    PROFILE = "rexroth-vpcd"

    def __init__(self, wire, node, dice, period):
        super().__init__(wire, node, dice)
        self.command, self.pressure, self.is_blocked = 0, 0.0, False
        self.tpdos.append(Tpdo(1, "timer", period, self.payload, (0x2F100020, 0x2F070020)))
        self.base_objects()
        self.add(0x1016, 0, 1, 1)
        self.add(0x1016, 1, 4, 0)
        self.add_rpdo(1, 8, self.on_command)

    def payload(self):
        if not self.is_blocked:
            self.pressure += (self.command - self.pressure) * 0.3
        return little(round(self.pressure), 4) + little(round(self.pressure / 2), 4)

    def on_command(self, data):
        self.command = min(max(int.from_bytes(data[4:8], "little", signed=True), 0), 600 * 328)


class Sydfec(Slave):
    """Rexroth SYDFEC (RE 30027-Z): synchronous PDOs, an EMCY without data as boot sign (14), guarding."""

    PROFILE = "rexroth-sydfec"

    def __init__(self, wire, node, dice):
        super().__init__(wire, node, dice)
        self.command, self.actual, self.is_blocked = (0, 0), [0, 0], False
        self.tpdos.append(Tpdo(1, "sync", 1, self.payload, (0x50000008, 0x50010010, 0x50020010)))
        self.base_objects()
        for key in [key for key in self.kept if key[0] in (0x1017, 0x1018)]:
            del self.kept[key]
        self.add(0x100C, 0, 2, 500)
        self.add(0x100D, 0, 1, 3)
        self.add_rpdo(1, 5, self.on_command)

    def send_boot_sign(self):
        self.send(0x80 + self.node, b"")

    def check_guarding(self, limit):
        """12, 14.3: EMCY 8102, most significant byte first."""
        if self.clock.now - self.guarded_at >= limit and "guard" not in self.errors:
            self.errors["guard"] = 0x10
            self.send(0x80 + self.node, bytes([0x81, 0x02, 0x10]) + bytes(5))
            self.enter(0x7F)

    def on_guard(self, frame):
        super().on_guard(frame)
        if frame.remote and self.errors.pop("guard", None):
            self.send(0x80 + self.node, bytes(8))

    def on_command(self, data):
        self.command = (int.from_bytes(data[1:3], "little", signed=True), int.from_bytes(data[3:5], "little", signed=True))

    def payload(self):
        for at in (0, 1):
            if not self.is_blocked:
                self.actual[at] += round((min(self.command[at], 16383) - self.actual[at]) * 0.4)
        return bytes([0x08]) + little(self.actual[0], 2) + little(self.actual[1], 2)


def is_started(slave):
    return slave.is_powered and slave.state == OPERATIONAL
