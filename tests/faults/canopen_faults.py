"""Failure modes of CANopen machines. Each function arms one and returns its truth, or None if the machine lacks the part.

Component names and modes are those of the ground truth; a mode is named after what fails, not after what a program prints.
"""
import slaves as kinds
from bench import SECOND, CyclicTask, Station, micros
from canopen import ENTER_PRE_OPERATIONAL, RESET_NODE, STOP
from truth import Fault

MODES = {}


def mode(function):
    MODES[function.__name__.replace("_", "-")] = function
    return function


def monitored(machine):
    return [slave for slave in machine.slaves
            if slave.kept.get((0x1017, 0), (2, 0))[1] or slave.node in machine.master.guard_period
            or any(write[0] == 0x1017 for write in machine.master.writes[slave.node])]


def periodic(machine):
    return [slave for slave in machine.slaves if slave.tpdos[0].kind in ("timer", "sync") or hasattr(slave, "analogue")]


def with_analogue(machine):
    return [slave for slave in machine.slaves if hasattr(slave, "analogue")]


def pick(machine, dice, candidates):
    return dice.pick(candidates) if candidates else None


# Supply and wire ------------------------------------------------------------------------------------------------------
@mode
def node_silent(machine, dice, at):
    """A node loses its supply for good."""
    slave = dice.pick(machine.slaves)
    machine.clock.at(at, slave.power_off)
    return Fault("node", ["node-silent", "node-wire", "node-restart"], at, [slave.node], before=3)


@mode
def node_restart(machine, dice, at):
    """A short loss of the supply of one node."""
    slave = dice.pick(machine.slaves)
    time = micros(dice.pick([0.05, 0.3, 1.0, 4.0]))
    machine.clock.at(at, slave.power_off)
    machine.clock.at(at + time, slave.power_on)
    return Fault("node", "node-restart", at, [slave.node], end=at + time, severity=f"{time // 1000} ms", before=3)


@mode
def watchdog_reset(machine, dice, at):
    """The node's processor resets itself several times."""
    slave = dice.pick(machine.slaves)
    count = dice.number(2, 4)
    for number in range(count):
        machine.clock.at(at + number * micros(2.5), lambda: slave.is_powered and slave.boot())
    return Fault("node", "node-restart", at, [slave.node], end=at + (count - 1) * micros(2.5), severity=f"{count} times")


@mode
def node_wire(machine, dice, at):
    """The connector of one node is loose: silent, then back in its state."""
    slave = dice.pick(machine.slaves)
    time = micros(dice.real(1.5, 4))
    machine.clock.at(at, lambda: setattr(slave, "segment", 1))
    machine.clock.at(at + time, lambda: setattr(slave, "segment", 0))
    return Fault("node", ["node-wire", "node-silent"], at, [slave.node], end=at + time, severity=f"{time // 1000} ms")


@mode
def group_supply(machine, dice, at):
    """Two or more nodes share a supply that fails, for good or for a moment."""
    if len(machine.slaves) < 3:
        return None
    group = dice.some(machine.slaves, dice.number(2, len(machine.slaves) - 1))
    returns = dice.chance(0.6)
    time = micros(dice.pick([0.2, 1.0, 3.0]))
    for slave in group:
        machine.clock.at(at + dice.number(0, 3000), slave.power_off)
        if returns:
            machine.clock.at(at + time + dice.number(0, 20_000), slave.power_on)
    modes = ["group-supply"] if returns else ["group-supply", "trunk-interrupted"]
    return Fault("group", modes, at, [slave.node for slave in group], end=at + time if returns else None)


@mode
def trunk_interrupted(machine, dice, at):
    """The trunk is interrupted: all nodes after a point disappear for the recorder and the master."""
    if len(machine.slaves) < 3:
        return None
    group = machine.slaves[dice.number(1, len(machine.slaves) - 2):]
    time = micros(dice.real(1.5, 5))
    for slave in group:
        machine.clock.at(at, lambda slave=slave: setattr(slave, "segment", 1))
        machine.clock.at(at + time, lambda slave=slave: setattr(slave, "segment", 0))
    return Fault("wire", "trunk-interrupted", at, [slave.node for slave in group], end=at + time)


@mode
def bus_disturbed(machine, dice, at):
    """Interference on the wire: error frames and repeated frames in bursts."""
    share, time = dice.pick([0.1, 0.3, 0.6]), micros(dice.real(0.3, 4))

    def disturb():
        machine.wire.disturbed_until, machine.wire.disturbance = at + time, share
    machine.clock.at(at, disturb)
    return Fault("wire", "bus-disturbed", at, end=at + time, severity=f"{share:.0%}", needs_errors=True)


@mode
def node_bus_off(machine, dice, at):
    """Errors at one node: error frames, then its controller is bus-off and comes back by a restart."""
    slave = dice.pick(machine.slaves)

    def disturb():
        machine.wire.disturbed_until, machine.wire.disturbance = at + 80_000, 0.8
        for number in range(16):
            machine.clock.after(number * 4000, lambda: machine.wire.add_error(0x088, bytes([0, 0, 0x04, 0, 0, 0, 0, 0])))
    machine.clock.at(at, disturb)
    machine.clock.at(at + 70_000, lambda: setattr(slave, "is_bus_off", True))
    returns = dice.chance(0.5)
    if returns:
        machine.clock.at(at + micros(2.5), lambda: (setattr(slave, "is_bus_off", False), slave.boot()))
    end = at + micros(2.5) if returns else None
    return Fault("node", ["node-bus-off", "bus-disturbed"], at, [slave.node], end=end, needs_errors=True)


# One node -------------------------------------------------------------------------------------------------------------
@mode
def application_stalled(machine, dice, at):
    """The application of a node stops: heartbeats continue, PDOs and SDO responses end."""
    slave = pick(machine, dice, [each for each in monitored(machine) if each in periodic(machine)])
    if not slave:
        return None
    machine.clock.at(at, lambda: setattr(slave, "is_stalled", True))
    return Fault("node", ["application-stalled", "stream-stopped"], at, [slave.node])


@mode
def heartbeat_stopped(machine, dice, at):
    """Only the heartbeats of a node end; its PDOs continue."""
    slave = pick(machine, dice, [each for each in monitored(machine)
                                 if each.node not in machine.master.guard_period and each in periodic(machine)])
    if not slave:
        return None
    machine.clock.at(at, lambda: setattr(slave, "has_heartbeat", False))
    machine.master.reaction = "none"
    return Fault("node", "heartbeat-stopped", at, [slave.node])


@mode
def stream_stopped(machine, dice, at):
    """One TPDO of a node ends; all its other messages continue."""
    slave = pick(machine, dice, [each for each in periodic(machine) if each.tpdos[0].kind in ("timer", "sync")])
    if not slave:
        return None
    machine.clock.at(at, lambda: setattr(slave.tpdos[0], "is_stopped", True))
    return Fault("node", ["stream-stopped", "application-stalled"], at, [slave.node])


@mode
def stream_slower(machine, dice, at):
    """A cyclic TPDO becomes slower by a factor."""
    slave = pick(machine, dice, [each for each in machine.slaves if each.tpdos[0].kind == "timer"])
    if not slave:
        return None
    factor, time = dice.pick([3, 5, 10]), micros(dice.real(3, 6))

    def slow(share):
        pdo = slave.tpdos[0]
        if pdo.task:
            pdo.task.period = round(pdo.period * share)
    machine.clock.at(at, lambda: slow(factor))
    machine.clock.at(at + time, lambda: slow(1))
    return Fault("node", "stream-slower", at, [slave.node], end=at + time, severity=f"x{factor}")


@mode
def value_frozen(machine, dice, at):
    """A measured value no longer changes, the message continues."""
    slave = pick(machine, dice, with_analogue(machine))
    if not slave:
        return None
    machine.clock.at(at, lambda: slave.analogue.freeze(at))
    if hasattr(slave, "other"):
        machine.clock.at(at, lambda: slave.other.freeze(at))
    return Fault("process", "value-frozen", at, [slave.node], after=6)


@mode
def value_jumps(machine, dice, at):
    """A loose sensor: single values jump to the limit."""
    slave = pick(machine, dice, with_analogue(machine))
    if not slave:
        return None
    share = dice.pick([0.01, 0.05, 0.2])
    machine.clock.at(at, lambda: setattr(slave.analogue, "jumps", share))
    return Fault("process", "value-jumps", at, [slave.node], severity=f"{share:.0%}", after=8)


@mode
def duplicate_node(machine, dice, at):
    """A second device with the same node-ID is connected, started or in pre-operational."""
    slave = pick(machine, dice, [each for each in machine.slaves if isinstance(each, (kinds.Generic, kinds.Encoder406, kinds.Drive402))])
    if not slave:
        return None
    pdo = slave.tpdos[0]
    if isinstance(slave, kinds.Drive402):
        twin = kinds.Drive402(machine.wire, slave.node, dice, pdo.kind, pdo.period)
    else:
        twin = type(slave)(machine.wire, slave.node, dice, pdo.kind, pdo.period)
    twin.add(0x1017, 0, 2, dice.pick([100, 200, 500]))
    twin.is_self_starting = dice.chance(0.5)
    machine.clock.at(at, twin.power_on)
    return Fault("node", "duplicate-node", at, [slave.node], after=5)


@mode
def device_fault(machine, dice, at):
    """The device reports an internal fault by EMCY and leaves its active state."""
    code, register = dice.pick([(0x2310, 0x03), (0x3210, 0x05), (0x4210, 0x09), (0x5000, 0x01), (0x7300, 0x21)])
    slave = pick(machine, dice, [each for each in machine.slaves if not isinstance(each, (kinds.Sydfec, kinds.Ifb))])
    if not slave:
        return None

    def fail():
        slave.is_fault_lasting = True
        if hasattr(slave, "fault"):
            slave.fault(code, register)
        else:
            slave.raise_error(code, register)
            if dice.chance(0.3):
                slave.react()
    machine.clock.at(at, fail)
    return Fault("node", "device-fault", at, [slave.node])


@mode
def left_operational(machine, dice, at):
    """A node changes to pre-operational by itself, without EMCY."""
    slave = pick(machine, dice, monitored(machine))
    if not slave:
        return None
    machine.clock.at(at, lambda: slave.enter(0x7F))
    return Fault("node", "left-operational", at, [slave.node])


@mode
def axis_blocked(machine, dice, at):
    """Set points arrive, the device is enabled, the actual value does not follow."""
    slave = pick(machine, dice, [each for each in machine.slaves if hasattr(each, "is_blocked") and not isinstance(each, kinds.Md2)])
    if not slave:
        return None
    if isinstance(slave, kinds.Drive402):
        slave.has_following_error = dice.chance(0.5)
    machine.clock.at(at, lambda: setattr(slave, "is_blocked", True))
    return Fault("process", ["axis-blocked", "device-fault"], at, [slave.node], after=8)


@mode
def not_enabled(machine, dice, _at):
    """The enable input or the supply of the power stage is missing: commands have no effect."""
    slave = pick(machine, dice, [each for each in machine.slaves if hasattr(each, "has_voltage")])
    if not slave:
        return None
    slave.has_voltage = False
    return Fault("node", "not-enabled", machine.settled, [slave.node], before=0, after=5)


@mode
def enable_lost(machine, dice, at):
    """The enable input opens while the device is active."""
    slave = pick(machine, dice, [each for each in machine.slaves if hasattr(each, "has_voltage")])
    if not slave:
        return None

    def lose():
        slave.has_voltage = False
        slave.status = 0x250 if isinstance(slave, kinds.Drive402) else 0x08
    machine.clock.at(at, lose)
    return Fault("node", ["enable-lost", "not-enabled"], at, [slave.node])


@mode
def settings_lost(machine, dice, at):
    """A restart with lost settings: the heartbeat time and event timer of the device are 0 afterwards."""
    slave = pick(machine, dice, [each for each in machine.slaves
                                 if isinstance(each, (kinds.Generic, kinds.Encoder406)) and each.kept[(0x1017, 0)][1]])
    if not slave:
        return None
    machine.master.writes[slave.node] = []

    def forget():
        slave.power_off()
        slave.add(0x1017, 0, 2, 0)
        slave.tpdos[0].period *= 5 if slave.tpdos[0].kind == "timer" else 1
        slave.power_on()
    machine.clock.at(at, forget)
    return Fault("node", ["settings-lost", "node-restart", "heartbeat-stopped"], at, [slave.node])


# Controller -----------------------------------------------------------------------------------------------------------
@mode
def controller_silent(machine, dice, at):
    """The controller stops: SYNC, commands, guarding requests and its heartbeat end."""
    machine.clock.at(at, machine.master.power_off)
    nodes = [machine.master.node] if machine.master.node else []
    return Fault("controller", ["controller-silent", "sync-stopped", "set-points-stopped"], at, nodes)


@mode
def sync_stopped(machine, dice, at):
    """Only SYNC ends; the controller goes on."""
    if not machine.master.has_sync:
        return None

    def stop():
        task = machine.master.tasks.pop("sync", None)
        if task:
            task.stop()
    machine.clock.at(at, stop)
    return Fault("sync", "sync-stopped", at)


@mode
def sync_twice(machine, dice, at):
    """A second SYNC producer."""
    if not machine.master.has_sync:
        return None
    other = Station(machine.wire, "second SYNC producer")
    other.is_powered = True
    period = round(machine.master.sync_period * dice.pick([1.0, 1.02, 2.0]))
    phase = machine.master.sync_period // 3
    machine.clock.at(at, lambda: CyclicTask(other, period, lambda: other.send(0x080, b""), jitter=50, phase=phase))
    return Fault("sync", "sync-twice", at)


@mode
def controller_late(machine, dice, at):
    """The controller is overloaded: its cyclic messages are late."""
    if not machine.master.has_sync and not machine.master.guard_period:
        return None
    time = micros(dice.real(2, 5))
    late = machine.master.sync_period * dice.number(1, 4)
    machine.clock.at(at, lambda: setattr(machine.master, "lateness", late))
    machine.clock.at(at + time, lambda: setattr(machine.master, "lateness", 0))
    return Fault("controller", ["controller-late", "sync-late"], at, end=at + time, severity=f"{late // 1000} ms")


@mode
def set_points_stopped(machine, dice, at):
    """The task of the controller that sends the commands of one node ends."""
    slave = pick(machine, dice, [each for each in machine.slaves if 1 in each.rpdos])
    if not slave:
        return None

    def stop():
        task = machine.master.tasks.pop(("command", slave.node), None)
        if task:
            task.stop()
    machine.clock.at(at, stop)
    return Fault("controller", "set-points-stopped", at, effects=[slave.node])


@mode
def guarding_stopped(machine, dice, at):
    """The controller no longer guards a node, which then reports it."""
    nodes = [slave for slave in machine.slaves if slave.node in machine.master.guard_period]
    slave = pick(machine, dice, nodes)
    if not slave:
        return None

    def stop():
        machine.master.tasks[("guard", slave.node)].stop()
    machine.clock.at(at, lambda: ("guard", slave.node) in machine.master.tasks and stop())
    return Fault("controller", "guarding-stopped", at, effects=[slave.node])


@mode
def foreign_nmt(machine, dice, at):
    """A second NMT master puts a node or all nodes into another state."""
    other = Station(machine.wire, "second NMT master")
    other.is_powered = True
    target = dice.pick([0] + [slave.node for slave in machine.slaves])
    command = dice.pick([ENTER_PRE_OPERATIONAL, STOP, RESET_NODE])
    machine.clock.at(at, lambda: other.send(0x000, [command, target]))
    return Fault("controller", "foreign-nmt", at, effects=[target] if target else [])


@mode
def consumer_short(machine, dice, _at):
    """A node monitors the controller or another node with less time than the producer's period."""
    producer = machine.master.node
    period = machine.master.heartbeat_period // 1000
    slave = pick(machine, dice, [each for each in machine.slaves if isinstance(each, kinds.Generic)])
    if not producer or not slave:
        return None
    machine.master.writes[slave.node] = [write for write in machine.master.writes[slave.node] if write[0] != 0x1016]
    machine.consume(slave, producer, period // 2)
    return Fault("node", "consumer-short", 2 * SECOND, [slave.node], from_boot=True, after=6)


@mode
def wrong_identifier(machine, dice, _at):
    """The RPDO of a node listens to another identifier than the controller sends."""
    slave = pick(machine, dice, [each for each in machine.slaves if 1 in each.rpdos and hasattr(each, "has_voltage")])
    if not slave:
        return None
    identifier, length, action = slave.rpdos[1]
    slave.rpdos[1] = (identifier + 0x100, length, action)
    slave.add(0x1400, 0, 1, 2)
    slave.add(0x1400, 1, 4, identifier)
    slave.add(0x1400, 2, 1, 255)
    machine.master.writes[slave.node].append((0x1400, 1, 4, identifier + 0x100))
    return Fault("node", ["wrong-identifier", "not-enabled"], 2 * SECOND, [slave.node], from_boot=True, after=8)


@mode
def short_command(machine, dice, _at):
    """The controller sends an RPDO that is shorter than its mapping."""
    slave = pick(machine, dice, [each for each in machine.slaves if isinstance(each, kinds.Drive402)])
    if not slave:
        return None
    machine.master.command_length[slave.node] = 4
    return Fault("controller", "short-command", 3 * SECOND, effects=[slave.node], from_boot=True, after=5)


# Start-up -------------------------------------------------------------------------------------------------------------
@mode
def node_absent(machine, dice, _at):
    """A configured node is missing; the controller asks for it again and again."""
    slave = dice.pick(machine.slaves)
    machine.absent = slave.node
    return Fault("node", ["node-absent", "node-silent"], 2 * SECOND, [slave.node], from_boot=True, after=6)


@mode
def wrong_device(machine, dice, _at):
    """A device with another identity has the node-ID: the controller does not start it."""
    slave = pick(machine, dice, [each for each in machine.slaves if (0x1018, 1) in each.kept])
    if not slave:
        return None
    machine.master.identities[slave.node] = [slave.identity[0] + 1] + slave.identity[1:]
    machine.master.starts_all = False
    return Fault("node", ["wrong-device", "not-started"], 2 * SECOND, [slave.node], from_boot=True, after=6)


@mode
def write_refused(machine, dice, _at):
    """A write of the start-up is refused: the controller does not start the node."""
    slave = pick(machine, dice, [each for each in machine.slaves if isinstance(each, kinds.Generic)])
    if not slave:
        return None
    place, code = dice.pick([((0x2100, 0), 0x06090030), ((0x2101, 0), 0x08000022), ((0x2100, 0), 0x06010002)])
    slave.refuses[place] = code
    machine.master.writes[slave.node].append((*place, 2, dice.number(1, 999)))
    machine.master.starts_all = False
    return Fault("node", ["write-refused", "not-started"], 2 * SECOND, [slave.node], from_boot=True, after=6)


@mode
def never_started(machine, dice, _at):
    """The controller never sends the start command to one node."""
    slave = pick(machine, dice, monitored(machine))
    if not slave:
        return None
    machine.master.starts_all = False
    start = machine.master.start
    machine.master.start = lambda each: None if each is slave else start(each)
    return Fault("controller", "not-started", 2 * SECOND, [slave.node], from_boot=True, after=8)


@mode
def sync_missing(machine, dice, _at):
    """Synchronous TPDOs are configured, and no SYNC is produced."""
    slave = pick(machine, dice, [each for each in machine.slaves if each.tpdos[0].kind == "sync"])
    if not slave:
        return None
    machine.master.has_sync = False
    return Fault("sync", "sync-missing", 3 * SECOND, effects=[slave.node], from_boot=True, after=6)


# Load and recorder ----------------------------------------------------------------------------------------------------
@mode
def babbling(machine, dice, at):
    """A node sends one identifier at the highest rate."""
    slave = dice.pick(machine.slaves)
    time = micros(dice.real(1, 3))
    gap = dice.pick([400, 800, 2000])
    identifier, data = 0x180 + slave.node, bytes(8)

    def send():
        if machine.clock.now < at + time and slave.is_on_bus():
            slave.send(identifier, data)
            machine.clock.after(gap, send)
    machine.clock.at(at, send)
    return Fault("node", ["babbling", "bus-overloaded"], at, [slave.node], end=at + time, severity=f"{gap} µs")


@mode
def input_bounces(machine, dice, at):
    """A bouncing input: the event-driven TPDO of a module is sent all the time."""
    slave = pick(machine, dice, [each for each in machine.slaves if isinstance(each, kinds.Module401)])
    if not slave:
        return None
    time = micros(dice.real(1.5, 4))
    machine.clock.at(at, lambda: setattr(slave, "bounces", True))
    machine.clock.at(at + time, lambda: setattr(slave, "bounces", False))
    return Fault("process", ["input-bounces", "babbling"], at, [slave.node], end=at + time)


@mode
def receive_overflow(machine, dice, at):
    """The adapter of the recorder loses frames and reports it."""
    time = micros(dice.real(0.2, 2.0))
    machine.overflows.append((at, at + time, dice.real(0.3, 0.9)))
    return Fault("recorder", "receive-overflow", at, end=at + time, needs_errors=True)
