"""The controller of a CANopen machine: start-up after CiA 302-2, SYNC, set points, error control; and a service tool."""
from bench import SECOND, CyclicTask, Station, micros
from canopen import (ENTER_PRE_OPERATIONAL, OPERATIONAL, RESET_COMMUNICATION, RESET_NODE, START, SdoClient, little)
from slaves import Drive402, Module401, Sydfec, Valve408, Vpcd


class Master(Station):
    """NMT master, SDO client, SYNC producer and consumer of error control."""

    def __init__(self, wire, dice, slaves):
        super().__init__(wire, "master")
        self.slaves = slaves
        self.node = dice.pick([None, None, 127, 1, 126])
        if self.node in [slave.node for slave in slaves]:
            self.node = None
        self.heartbeat_period = micros(dice.pick([0.1, 0.2, 0.5, 1.0])) if self.node else 0
        self.heartbeat_state = dice.pick([OPERATIONAL, OPERATIONAL, 0x7F])
        self.boot_time = micros(dice.real(0.2, 1.2))
        self.resets = dice.pick([None, RESET_COMMUNICATION, RESET_NODE])
        self.starts_all = dice.chance(0.5)
        self.sync_period = micros(dice.pick([0.01, 0.02, 0.05, 0.1]))
        self.has_sync = any(pdo.kind == "sync" for slave in slaves for pdo in slave.tpdos)
        self.sync_counter = dice.pick([0, 0, 0, 10, 240])
        self.counter = 0
        self.command_period = micros(dice.pick([0.02, 0.05, 0.1, 0.2]))
        self.reaction = dice.pick(["none", "none", "reset", "stop"])
        self.guard_period = {}          # node → µs
        self.heard, self.lost, self.started, self.identities = {}, set(), set(), {}
        self.writes = {slave.node: [] for slave in slaves}      # node → [(index, sub, size, value)]
        self.command_ids = {}           # node → identifier of RPDO1
        self.command_length = {}
        self.targets, self.next_target = {}, {}
        self.tasks = {}
        self.client = SdoClient(self, micros(dice.pick([0.3, 0.5, 1.0])))
        self.is_commanding = True
        self.holds_control = set()      # nodes whose control word stays 0
        self.is_booting, self.ready = True, set()
        for slave in slaves:
            wire.listen(self, 0x700 + slave.node, lambda frame, slave=slave: self.on_error_control(slave, frame))
            wire.listen(self, 0x080 + slave.node, lambda frame, slave=slave: self.on_ready_emcy(slave, frame))

    def on_power(self):
        epoch = self.epoch
        self.clock.after(self.boot_time, lambda: epoch == self.epoch and self.is_powered and self.begin())

    def begin(self, is_powering_up=True):
        self.client.cancel()
        self.started, self.lost, self.heard, self.ready = set(), set(), {}, set()
        self.is_booting = True
        if self.node:
            if is_powering_up:
                self.send(0x700 + self.node, [0])
            self.tasks["heartbeat"] = CyclicTask(self, self.heartbeat_period,
                                                 lambda: self.send(0x700 + self.node, [self.heartbeat_state]), jitter=800)
        if self.resets:
            self.send_later(20_000, 0x000, [self.resets, 0])
        epoch = self.epoch
        self.clock.after(micros(1.2), lambda: epoch == self.epoch and self.boot_all())

    def boot_all(self):
        if self.has_sync:
            self.tasks["sync"] = CyclicTask(self, self.sync_period, self.send_sync, jitter=80)
        self.is_booting = False
        for slave in self.slaves:
            self.boot_slave(slave)

    def send_sync(self):
        if self.sync_counter:
            self.counter = self.counter % self.sync_counter + 1
            self.send(0x080, [self.counter])
        else:
            self.send(0x080, b"")

    # Start-up of a slave: CiA 302-2 §5 --------------------------------------------------------------------------------
    def boot_slave(self, slave):
        if (0x1000, 0) not in slave.kept:
            self.configure(slave, 0)
            return
        self.client.read(slave.node, 0x1000, 0, lambda value: self.on_device_type(slave, value))

    def on_device_type(self, slave, value):
        if value is None:
            self.boot_again(slave)
            return
        if (0x1018, 1) in slave.kept:
            expected = self.identities.get(slave.node, slave.identity)
            self.read_identity(slave, 1, expected)
        else:
            self.configure(slave, 0)

    def boot_again(self, slave):
        """No response: the slave is asked again."""
        epoch = self.epoch
        self.clock.after(SECOND, lambda: epoch == self.epoch and self.boot_slave(slave))

    def read_identity(self, slave, sub, expected):
        def check(value):
            if value is None or value != expected[sub - 1]:
                return                  # another device: not started
            if sub < 2:
                self.read_identity(slave, sub + 1, expected)
            else:
                self.configure(slave, 0)
        self.client.read(slave.node, 0x1018, sub, check)

    def configure(self, slave, at):
        writes = self.writes[slave.node]
        if at == len(writes):
            self.on_configured(slave)
            return

        def check(value):
            if value is None:
                self.boot_again(slave)
            elif not isinstance(value, tuple):
                self.configure(slave, at + 1)       # a refused write ends the start-up
        self.client.write(slave.node, *writes[at], check)

    def on_configured(self, slave):
        self.ready.add(slave.node)
        if not self.starts_all or self.started:
            self.start(slave)
        elif len(self.ready) == len(self.slaves):
            self.send(0x000, [START, 0])
            for each in self.slaves:
                self.on_started(each)

    def start(self, slave):
        self.send(0x000, [START, slave.node])
        self.on_started(slave)

    def on_started(self, slave):
        self.started.add(slave.node)
        self.lost.discard(slave.node)
        self.begin_error_control(slave)
        self.begin_commands(slave)

    # Error control ----------------------------------------------------------------------------------------------------
    def begin_error_control(self, slave):
        period = self.guard_period.get(slave.node)
        self.heard[slave.node] = self.clock.now
        if period and ("guard", slave.node) not in self.tasks:
            self.tasks["guard", slave.node] = CyclicTask(
                self, period, lambda: self.send(0x700 + slave.node, b"\0", remote=True), jitter=400)

    def limit(self, slave):
        period = self.guard_period.get(slave.node)
        return 3 * period if period else slave.value(0x1017) * 2500

    def on_ready_emcy(self, slave, frame):
        if isinstance(slave, Sydfec) and not frame.data:
            self.on_boot_sign(slave)

    def on_error_control(self, slave, frame):
        if frame.remote or not frame.data:
            return
        self.heard[slave.node] = self.clock.now
        if frame.data == b"\0" and slave.state == 0x7F and not frame.remote:
            self.on_boot_sign(slave)
            return
        limit = self.limit(slave)
        if limit:
            epoch = self.epoch
            self.clock.after(limit, lambda: epoch == self.epoch and self.check_heard(slave, limit))

    def on_boot_sign(self, slave):
        if self.is_booting or not self.is_on_bus():
            return
        if slave.node in self.started or slave.node in self.lost:
            self.started.discard(slave.node)
            self.boot_slave(slave)

    def check_heard(self, slave, limit):
        if self.clock.now - self.heard.get(slave.node, self.clock.now) < limit or slave.node not in self.started:
            return
        self.lost.add(slave.node)
        self.started.discard(slave.node)
        self.on_lost(slave)

    def on_lost(self, slave):
        if self.reaction == "reset":
            self.send(0x000, [RESET_NODE, slave.node])
        elif self.reaction == "stop":
            for each in self.slaves:
                self.targets[each.node] = 0
            self.is_commanding = False

    # Set points -------------------------------------------------------------------------------------------------------
    def begin_commands(self, slave):
        if 1 in slave.rpdos and ("command", slave.node) not in self.tasks:
            period = self.command_period
            if isinstance(slave, Sydfec):       # one command per SYNC (RE 30027-Z 9)
                period = max(period, 2 * self.sync_period)
            self.tasks["command", slave.node] = CyclicTask(self, period, lambda: self.send_command(slave), jitter=500)

    def target(self, slave, low, high):
        node = slave.node
        if not self.is_commanding:
            return 0
        if self.clock.now >= self.next_target.get(node, 0):
            self.targets[node] = self.dice.number(low, high)
            self.next_target[node] = self.clock.now + micros(self.dice.real(1.5, 5))
        return self.targets[node]

    def send_command(self, slave):
        if slave.node not in self.started:
            return
        identifier, length, _ = slave.rpdos[1]
        data = self.command_data(slave, length)
        identifier = self.command_ids.get(slave.node, identifier)
        self.send(identifier, data[:self.command_length.get(slave.node, 8)])

    def command_data(self, slave, length):
        control = 0
        if hasattr(slave, "next_control"):
            control = 0 if slave.node in self.holds_control else slave.next_control()
        if isinstance(slave, Drive402):
            is_enabled = slave.status & 0x6F == 0x27
            return little(control, 2) + little(self.target(slave, -1500, 1500) if is_enabled else 0, 4)
        if isinstance(slave, Valve408):
            target = self.target(slave, -12000, 12000) if slave.status == 0x0F else 0
            return (little(control, 2) + little(abs(target) // 100 if length == 6 else target, 2)).ljust(length, b"\0")
        if isinstance(slave, Vpcd):
            return little(0, 4) + little(self.target(slave, 0, 80_000), 4)
        if isinstance(slave, Sydfec):
            return bytes([0]) + little(self.target(slave, 0, 12_000), 2) + little(self.target(slave, 0, 12_000), 2)
        if isinstance(slave, Module401):
            self.target(slave, 0, 255)
            return bytes([self.targets.get(slave.node, 0) & 0xFF])
        return little(self.target(slave, 0, 30_000), 2).ljust(length, b"\x01")

    # What the operator does -------------------------------------------------------------------------------------------
    def stand_still(self, command=ENTER_PRE_OPERATIONAL):
        """A planned standstill: set points to 0, then all nodes leave operational."""
        self.is_commanding = False
        epoch = self.epoch

        def leave():
            if epoch != self.epoch:
                return
            for key, task in list(self.tasks.items()):
                if key == "sync" or key[0] == "command":
                    task.stop()
                    del self.tasks[key]
            self.send(0x000, [command, 0])
        self.clock.after(micros(0.5), leave)

    def restart(self):
        self.is_commanding = True
        if self.has_sync and "sync" not in self.tasks:
            self.tasks["sync"] = CyclicTask(self, self.sync_period, self.send_sync, jitter=80)
        self.send(0x000, [START, 0])
        for slave in self.slaves:
            self.on_started(slave)


class Tool(Station):
    """A service tool: a further SDO client."""

    def __init__(self, wire, limit=0.05):
        super().__init__(wire, "tool")
        self.client = SdoClient(self, micros(limit))
        self.power_on()

    def scan(self, first=1, last=127):
        for node in range(first, last + 1):
            self.client.read(node, 0x1000, 0)
