"""Random CANopen machines."""
from bench import SECOND, Clock, Wire, micros
from master import Master, Tool
from slaves import Drive402, Encoder406, Generic, Ifb, Md2, Module401, Pve, Sydfec, Vpcd

PERIODS = [0.02, 0.05, 0.1, 0.1, 0.2]


class CanopenMachine:
    """Slaves along one trunk, in this order: recorder, master, slaves. Two supplies feed the slaves."""

    family = "canopen"

    def __init__(self, dice, has_profiles, shift=0):
        self.dice, self.clock = dice, Clock()
        self.has_profiles = has_profiles
        self.wire = Wire(self.clock, dice, "can0", 250_000)
        count = dice.number(2, 6)
        first = dice.pick([1, 1, 2, 5, 16, 32])
        step = dice.pick([1, 1, 1, 2, 3])
        nodes = [first + step * at + shift for at in range(count)]
        self.slaves = [self.slave(node) for node in nodes]
        self.master = Master(self.wire, dice, self.slaves)
        self.supplies = {slave.node: dice.number(0, 1) for slave in self.slaves}
        self.configure()
        self.wire.bit_rate = self.bit_rate()
        self.tool = None
        self.overflows, self.absent, self.late = [], None, None

    def slave(self, node):
        dice, wire = self.dice, self.wire
        kinds = ["generic", "generic", "encoder", "module", "drive"]
        if self.has_profiles:
            kinds = ["drive", "md2", "pve", "ifb", "vpcd", "sydfec", "generic"]
        kind = dice.pick(kinds)
        tpdo = dice.pick(["timer", "timer", "sync"])
        period = dice.pick([1, 1, 2, 4]) if tpdo == "sync" else micros(dice.pick(PERIODS))
        if kind == "drive":
            return Drive402(wire, node, dice, tpdo, period)
        if kind == "module":
            return Module401(wire, node, dice, "timer", micros(dice.pick(PERIODS)))
        if kind == "encoder":
            return Encoder406(wire, node, dice, tpdo, period)
        if kind == "vpcd":
            return Vpcd(wire, node, dice, micros(dice.pick(PERIODS)))
        if kind == "sydfec":
            return Sydfec(wire, node, dice) if node <= 16 else Md2(wire, node, dice)    # its switch has 1 to 16
        if kind in ("md2", "pve", "ifb"):
            return {"md2": Md2, "pve": Pve, "ifb": Ifb}[kind](wire, node, dice)
        return Generic(wire, node, dice, tpdo, period)

    def configure(self):
        """Error control, consumers and event timers: from the device's memory or written at the start-up."""
        dice, master = self.dice, self.master
        for slave in self.slaves:
            if isinstance(slave, (Sydfec, Ifb)):
                if dice.chance(0.8):
                    master.guard_period[slave.node] = micros(dice.pick([0.1, 0.2, 0.3]))
                continue
            mode = dice.pick(["heartbeat", "heartbeat", "heartbeat", "guard"])
            if mode == "guard" and isinstance(slave, Generic):
                period = dice.pick([0.1, 0.2, 0.5])
                master.guard_period[slave.node] = micros(period)
                for index, size, value in ((0x100C, 2, round(period * 1000)), (0x100D, 1, 3)):
                    slave.add(index, 0, size, value)
                continue
            time = dice.pick([100, 200, 500, 1000])
            if dice.chance(0.5) or isinstance(slave, Vpcd):
                master.writes[slave.node].append((0x1017, 0, 2, time))
            else:
                slave.add(0x1017, 0, 2, time)
            if slave.tpdos[0].kind == "timer" and dice.chance(0.3) or isinstance(slave, Vpcd):
                period = slave.tpdos[0].period // 1000
                master.writes[slave.node].append((0x1800, 5, 2, period))
            if master.node and dice.chance(0.4) and isinstance(slave, (Generic, Drive402, Vpcd)):
                limit = master.heartbeat_period // 1000 * dice.number(3, 5)
                self.consume(slave, master.node, limit)
            if isinstance(slave, Pve) and dice.chance(0.5):
                slave.output_limit = micros(dice.real(0.6, 1.5))
        if dice.chance(0.3):
            master.sync_period = micros(dice.pick([0.05, 0.1]))

    def consume(self, slave, node, limit):
        slave.add(0x1016, 0, 1, 1)
        slave.add(0x1016, 1, 4, 0)
        self.master.writes[slave.node].append((0x1016, 1, 4, node << 16 | limit))

    def bit_rate(self):
        """The lowest usual bit rate with a load below 40 %."""
        rate = 40.0
        syncs = 1e6 / self.master.sync_period if self.master.has_sync else 0
        rate += syncs
        for slave in self.slaves:
            for pdo in slave.tpdos:
                shortest = 100_000 if pdo.kind == "change" else 20_000
                rate += syncs / max(1, pdo.period) if pdo.kind == "sync" else 1e6 / max(pdo.period, shortest)
            if 1 in slave.rpdos:
                rate += 1e6 / self.master.command_period * (2 if slave.tpdos[0].kind == "answer" else 1)
        usual = [125_000, 250_000, 500_000, 1_000_000]
        return next((each for each in usual if rate * 115 < 0.4 * each), usual[-1])

    def power_on(self):
        """All supplies within half a second; the master too."""
        for slave in self.slaves:
            delay = self.dice.number(0, 300_000)
            if self.late and self.late[0] is slave and self.clock.now < self.late[1]:
                delay = self.late[1]
            if slave.node != self.absent:
                self.clock.at(self.clock.now + delay, slave.power_on)
        self.clock.at(self.clock.now + self.dice.number(0, 500_000), self.master.power_on)

    settled = 7 * SECOND        # all nodes are started, drives enabled

    def add_tool(self, limit=0.05):
        self.tool = Tool(self.wire, limit)
        return self.tool

    def profiles(self):
        if not self.has_profiles:
            return {}
        return {str(slave.node): slave.PROFILE for slave in self.slaves if slave.PROFILE}

    def description(self):
        return {"bit_rate": self.wire.bit_rate, "master": self.master.node,
                "sync_ms": self.master.sync_period / 1000 if self.master.has_sync else None,
                "nodes": {str(slave.node): type(slave).__name__ for slave in self.slaves}}
