"""CANopen stations: slave, SDO client and master, after CiA 301 and CiA 302-2."""
from bench import SECOND, CyclicTask, Station, micros

STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x04, 0x05, 0x7F
START, STOP, ENTER_PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82
NO_OBJECT, NO_SUBINDEX, READ_ONLY, DEVICE_STATE = 0x06020000, 0x06090011, 0x06010002, 0x08000022


def little(value, size):
    return (value & (1 << 8 * size) - 1).to_bytes(size, "little")


class Tpdo:
    """A TPDO: `kind` is timer (period in µs), sync (every n-th), or change (`period`: event timer, 0 none)."""

    def __init__(self, number, kind, period, payload, entries=()):
        self.number, self.kind, self.period, self.payload, self.entries = number, kind, period, payload, entries
        self.syncs, self.last, self.last_time, self.task = 0, None, 0, None
        self.is_stopped = False         # the application no longer serves it


class Slave(Station):
    """A CANopen device. Subclasses add objects, PDOs and the behaviour of a profile."""

    DEVICE_TYPE = 0
    PROFILE = None                      # profile name for `--node`
    BOOT_SIGN = bytes([0])              # CiA 301 §7.2.8.3.3
    CHECKS_RPDO_LENGTH = True

    def __init__(self, wire, node, dice):
        super().__init__(wire, f"node {node}")
        self.node, self.state = node, 0
        self.boot_time = micros(dice.real(0.05, 0.6))
        self.answer_time = micros(dice.real(0.0004, 0.004))
        self.identity = [dice.number(1, 0xFFFF), dice.number(1, 0xFFFFF), 0x10000 + dice.number(0, 9), dice.number(1, 99999)]
        self.kept = {}                  # objects of the non-volatile memory: (index, sub) → (size, value)
        self.objects = {}
        self.refuses = {}               # (index, sub) → abort code
        self.tpdos, self.rpdos = [], {}
        self.consumed, self.errors = {}, {}
        self.is_stalled = False         # the application stands still, the stack continues
        self.has_heartbeat = True
        self.guard_toggle, self.is_guarded = 0, False
        self.answers_guarding = True
        self.error_reaction = PRE_OPERATIONAL   # object 1029, None: stays
        self.is_self_starting = False
        self.emcy_sources = []          # COB-IDs of object 1028
        self.output_limit = None        # time limit of RPDO1 in µs; `on_output_timeout` after it
        self.last_rpdo = 0
        wire.listen(self, 0x000, self.on_nmt)
        wire.listen(self, 0x600 + node, self.on_sdo)
        wire.listen(self, 0x700 + node, self.on_guard)
        wire.listen(self, 0x080, self.on_sync)
        wire.listen(self, None, self.on_any)

    # Objects ----------------------------------------------------------------------------------------------------------
    def add(self, index, sub, size, value):
        self.kept[(index, sub)] = (size, value)

    def value(self, index, sub=0):
        return self.objects.get((index, sub), (1, 0))[1]

    def set(self, index, sub, value):
        size = self.objects[(index, sub)][0]
        self.objects[(index, sub)] = (size, value)

    def base_objects(self):
        self.add(0x1000, 0, 4, self.DEVICE_TYPE)
        self.add(0x1001, 0, 1, 0)
        self.add(0x1017, 0, 2, 0)
        self.add(0x1018, 0, 1, 4)
        for sub, part in enumerate(self.identity, 1):
            self.add(0x1018, sub, 4, part)
        for pdo in self.tpdos:
            at = 0x1800 + pdo.number - 1
            self.add(at, 0, 1, 5)
            self.add(at, 1, 4, self.tpdo_id(pdo))
            self.add(at, 2, 1, {"sync": max(pdo.period, 1)}.get(pdo.kind, 255))
            self.add(at, 5, 2, 0 if pdo.kind == "sync" else pdo.period // 1000)
            self.add(at + 0x200, 0, 1, len(pdo.entries))
            for sub, entry in enumerate(pdo.entries, 1):
                self.add(at + 0x200, sub, 4, entry)

    def tpdo_id(self, pdo):
        return 0x80 + 0x100 * pdo.number + self.node

    # States -----------------------------------------------------------------------------------------------------------
    def on_power(self):
        self.boot()

    def boot(self):
        """Initialisation, then the boot sign and pre-operational."""
        self.epoch += 1
        self.state = 0
        self.objects = dict(self.kept)
        self.consumed, self.errors, self.guard_toggle, self.is_guarded = {}, {}, 0, False
        epoch = self.epoch
        self.clock.after(self.boot_time, lambda: epoch == self.epoch and self.is_powered and self.enter_first_state())

    def enter_first_state(self):
        self.state = PRE_OPERATIONAL
        self.send_boot_sign()
        self.start_heartbeat()
        self.on_boot()
        if self.is_self_starting:
            self.enter(OPERATIONAL)

    def send_boot_sign(self):
        self.send(0x700 + self.node, self.BOOT_SIGN)

    def on_boot(self):
        """The profile's part of the initialisation."""

    def enter(self, state):
        if state == self.state or self.state == 0:
            return
        self.state = state
        for pdo in self.tpdos:
            if pdo.task:
                pdo.task.stop()
                pdo.task = None
        if state == OPERATIONAL:
            self.last_rpdo = self.clock.now
            for pdo in self.tpdos:
                self.start_tpdo(pdo)
        self.on_state()

    def on_state(self):
        """The profile's part of a change of state."""

    def on_nmt(self, frame):
        if len(frame.data) != 2 or frame.data[1] not in (0, self.node) or self.state == 0:
            return
        command = frame.data[0]
        if command in (RESET_NODE, RESET_COMMUNICATION):
            self.boot()
        elif command in (START, STOP, ENTER_PRE_OPERATIONAL):
            self.enter({START: OPERATIONAL, STOP: STOPPED}.get(command, PRE_OPERATIONAL))

    # Error control ----------------------------------------------------------------------------------------------------
    def start_heartbeat(self):
        period = self.value(0x1017)
        if period and self.has_heartbeat:
            self.heartbeat_task = CyclicTask(self, period * 1000, self.send_heartbeat, jitter=600)

    def send_heartbeat(self):
        if self.has_heartbeat and self.value(0x1017):
            self.send(0x700 + self.node, [self.state])

    def on_guard(self, frame):
        if not frame.remote or self.state == 0 or not self.answers_guarding or self.value(0x1017):
            return
        self.is_guarded = True
        state = self.state | self.guard_toggle
        self.guard_toggle ^= 0x80
        self.send_later(self.answer_time, 0x700 + self.node, [state])
        self.guarded_at = self.clock.now
        limit = self.value(0x100C) * self.value(0x100D) * 1000
        if limit:
            epoch = self.epoch
            self.clock.after(limit, lambda: epoch == self.epoch and self.check_guarding(limit))

    def check_guarding(self, limit):
        if self.is_powered and self.clock.now - self.guarded_at >= limit and 0x8130 not in self.errors:
            self.raise_error(0x8130, 0x11)
            self.react()

    def on_any(self, frame):
        """Heartbeats of others (object 1016) and EMCYs of object 1028."""
        node = frame.identifier - 0x700
        if frame.extended or frame.remote or self.state == 0:
            return
        if 0 < node < 0x80 and node != self.node:
            self.on_foreign_heartbeat(node)
        elif frame.identifier in self.emcy_sources and frame.data[:2] != b"\0\0" and len(frame.data) == 8:
            self.send_later(0, 0x80 + self.node, little(0x9000, 2) + bytes([0x81]) + bytes(5))
            self.react()

    def on_foreign_heartbeat(self, node):
        limit = sum((value & 0xFFFF) * 1000 for (index, sub), (_, value) in self.objects.items()
                    if index == 0x1016 and sub and value >> 16 == node)
        if not limit:
            return
        self.consumed[node] = self.clock.now
        if (0x8130, node) in self.errors:
            self.clear_error((0x8130, node))
        epoch = self.epoch
        self.clock.after(limit, lambda: epoch == self.epoch and self.check_consumer(node, limit))

    def check_consumer(self, node, limit):
        if self.is_powered and self.clock.now - self.consumed[node] >= limit and (0x8130, node) not in self.errors:
            self.raise_error(0x8130, 0x11, key=(0x8130, node))
            self.react()

    def react(self):
        if self.error_reaction and self.state == OPERATIONAL:
            self.enter(self.error_reaction)

    # EMCY -------------------------------------------------------------------------------------------------------------
    def raise_error(self, code, register, extra=b"", key=None):
        self.errors[key or code] = register
        if (0x1001, 0) in self.objects:
            self.set(0x1001, 0, self.value(0x1001) | register)
        self.send(0x80 + self.node, little(code, 2) + bytes([self.value(0x1001) or register]) + extra.ljust(5, b"\0"))

    def clear_error(self, key):
        self.errors.pop(key, None)
        register = 0
        for bits in self.errors.values():
            register |= bits
        self.set(0x1001, 0, register)
        self.send(0x80 + self.node, bytes([0, 0, register]) + bytes(5))

    # PDO --------------------------------------------------------------------------------------------------------------
    def start_tpdo(self, pdo):
        pdo.last, pdo.syncs = None, 0
        if pdo.kind == "timer" and pdo.period:
            pdo.task = CyclicTask(self, pdo.period, lambda: self.send_tpdo(pdo), jitter=300, phase=0)
        elif pdo.kind == "change":
            pdo.task = CyclicTask(self, 10_000, lambda: self.check_change(pdo), jitter=3_000, phase=0)

    def send_tpdo(self, pdo):
        if self.state == OPERATIONAL and not self.is_stalled and not pdo.is_stopped:
            pdo.last, pdo.last_time = pdo.payload(), self.clock.now
            self.send(self.tpdo_id(pdo), pdo.last)

    def check_change(self, pdo):
        is_due = pdo.period and self.clock.now - pdo.last_time >= pdo.period
        if is_due or pdo.payload() != pdo.last:
            self.send_tpdo(pdo)

    def on_sync(self, frame):
        if self.state != OPERATIONAL or frame.extended:
            return
        for pdo in self.tpdos:
            if pdo.kind == "sync":
                pdo.syncs += 1
                if pdo.syncs >= max(pdo.period, 1):
                    pdo.syncs = 0
                    self.clock.after(self.dice.number(150, 900), lambda pdo=pdo: self.send_tpdo(pdo))

    def add_rpdo(self, number, length, action, identifier=None):
        identifier = identifier or 0x100 + 0x100 * number + self.node
        self.rpdos[number] = (identifier, length, action)
        self.wire.listen(self, identifier, lambda frame: self.on_rpdo_frame(number, frame))

    def on_rpdo_frame(self, number, frame):
        identifier, length, action = self.rpdos[number]
        if self.state != OPERATIONAL or frame.identifier != identifier or self.is_stalled:
            return
        if len(frame.data) < length:
            if self.CHECKS_RPDO_LENGTH:     # CiA 301 table 26: 8210, PDO not processed due to length error
                self.raise_error(0x8210, 0x11, key=0x8210)
            return
        self.last_rpdo = self.clock.now
        if self.output_limit:
            epoch = self.epoch
            self.clock.after(self.output_limit, lambda: epoch == self.epoch and self.check_output())
        action(frame.data)

    def check_output(self):
        if self.is_powered and self.state == OPERATIONAL and self.clock.now - self.last_rpdo >= self.output_limit:
            self.on_output_timeout()

    def on_output_timeout(self):
        """Set points are missing for `output_limit`."""

    # SDO server -------------------------------------------------------------------------------------------------------
    def on_sdo(self, frame):
        if self.state in (0, STOPPED) or len(frame.data) != 8 or self.is_stalled:
            return
        command, index, sub = frame.data[0], frame.data[1] | frame.data[2] << 8, frame.data[3]
        place = frame.data[1:4]
        delay = self.answer_time + self.dice.number(0, 300)
        if command == 0x80:
            return
        code = self.refuses.get((index, sub)) or self.missing(index, sub)
        if command == 0x40 and not code:
            size, value = self.objects[(index, sub)]
            answer = bytes([0x43 | (4 - size) << 2]) + place + little(value, size).ljust(4, b"\0")
        elif command & 0xE3 in (0x23, 0x22) and not code:
            size = 4 - (command >> 2 & 3)
            wanted = self.objects[(index, sub)][0]
            if size != wanted:
                code = 0x06070010
            else:
                value = int.from_bytes(frame.data[4:4 + size], "little")
                self.clock.after(delay, lambda: self.written(index, sub, value))
            answer = bytes([0x60]) + place + bytes(4)
        else:
            code = code or 0x05040001
            answer = b""
        if code:
            answer = bytes([0x80]) + place + little(code, 4)
        self.send_later(delay, 0x580 + self.node, answer)

    def missing(self, index, sub):
        if (index, sub) in self.objects:
            return 0
        return NO_SUBINDEX if any(key[0] == index for key in self.objects) else NO_OBJECT

    def written(self, index, sub, value):
        if (index, sub) not in self.objects:
            return
        self.set(index, sub, value)
        if index == 0x1017 and self.state:
            if getattr(self, "heartbeat_task", None):
                self.heartbeat_task.stop()
            self.start_heartbeat()
        if 0x1800 <= index < 0x1A00 and sub == 5:
            for pdo in self.tpdos:
                if pdo.number == index - 0x17FF and pdo.kind == "timer":
                    pdo.period = value * 1000
        if index == 0x1010 and value == 0x65766173:     # "save"
            self.set(index, sub, 1)
            for key in self.objects:
                if key != (0x1001, 0):
                    self.kept[key] = self.objects[key]


class SdoClient:
    """One transfer at a time; requests wait in a queue. `done(value)` gets None without response, ("abort", code) if refused."""

    def __init__(self, station, limit=SECOND):
        self.station, self.limit, self.queue, self.active = station, limit, [], None
        self.number = 0
        self.is_heard = set()

    def read(self, node, index, sub, done=None):
        self.request(node, bytes([0x40]) + little(index, 2) + bytes([sub]) + bytes(4), done)

    def write(self, node, index, sub, size, value, done=None):
        command = 0x23 | (4 - size) << 2
        self.request(node, bytes([command]) + little(index, 2) + bytes([sub]) + little(value, size).ljust(4, b"\0"), done)

    def request(self, node, data, done):
        if node not in self.is_heard:
            self.is_heard.add(node)
            self.station.wire.listen(self.station, 0x580 + node, lambda frame: self.on_response(node, frame))
        self.queue.append((node, data, done))
        self.send_next()

    def send_next(self):
        if self.active or not self.queue:
            return
        self.active = self.queue.pop(0)
        self.number += 1
        number = self.number
        self.station.send(0x600 + self.active[0], self.active[1])
        self.station.clock.after(self.limit, lambda: self.expire(number))

    def expire(self, number):
        if self.active and number == self.number:
            self.finish(None)

    def on_response(self, node, frame):
        if not self.active or self.active[0] != node or frame.data[1:4] != self.active[1][1:4]:
            return
        if frame.data[0] == 0x80:
            self.finish(("abort", int.from_bytes(frame.data[4:8], "little")))
        else:
            self.finish(int.from_bytes(frame.data[4:8], "little"))

    def finish(self, value):
        done, self.active = self.active[2], None
        if done:
            done(value)
        epoch = self.station.epoch
        self.station.clock.after(self.station.dice.number(500, 3000), lambda: epoch == self.station.epoch and self.send_next())

    def cancel(self):
        self.queue, self.active = [], None
