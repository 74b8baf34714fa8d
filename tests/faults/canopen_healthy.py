"""What happens on healthy CANopen machines and tempts to a wrong conclusion."""
from bench import SECOND, CyclicTask, Station, micros
from canopen import ENTER_PRE_OPERATIONAL, RESET_COMMUNICATION, RESET_NODE, STOP

TEMPTING = {}


def tempting(function):
    TEMPTING[function.__name__.replace("_", "-")] = function
    return function


@tempting
def nothing(machine, dice, at):
    """The machine runs."""


@tempting
def planned_standstill(machine, dice, at):
    machine.clock.at(at, lambda: machine.master.stand_still(dice.pick([ENTER_PRE_OPERATIONAL, STOP])))
    if dice.chance(0.7):
        machine.clock.at(at + micros(dice.real(3, 8)), machine.master.restart)


@tempting
def planned_reset(machine, dice, at):
    """The controller resets all nodes and starts them again."""
    def reset():
        master = machine.master
        for task in master.tasks.values():
            task.stop()
        master.tasks, master.started = {}, set()
        master.resets = dice.pick([RESET_NODE, RESET_COMMUNICATION])
        master.epoch += 1
        master.begin(is_powering_up=False)
    machine.clock.at(at, reset)


@tempting
def power_cycle(machine, dice, at):
    """The machine is switched off and on."""
    time = micros(dice.real(4, 10))
    for station in [*machine.slaves, machine.master]:
        machine.clock.at(at + dice.number(0, 30_000), station.power_off)

    def on():
        machine.master.tasks = {}
        machine.power_on()
    machine.clock.at(at + time, on)


@tempting
def switched_off(machine, dice, at):
    """The machine is stopped and then switched off: all messages end together."""
    machine.clock.at(at, lambda: machine.master.stand_still(dice.pick([STOP, ENTER_PRE_OPERATIONAL])))
    for station in [*machine.slaves, machine.master]:
        machine.clock.at(at + micros(2), station.power_off)


@tempting
def scan(machine, dice, at):
    """A service tool asks all node-IDs."""
    tool = machine.add_tool(dice.pick([0.02, 0.05, 0.1]))
    machine.clock.at(at, tool.scan)


@tempting
def readout(machine, dice, at):
    """A service tool reads objects that exist and some that do not."""
    tool = machine.add_tool(0.5)

    def read():
        for slave in machine.slaves:
            for index, sub in ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1017, 0), (0x1008, 0), (0x2FFF, 0)):
                # The manuals of the devices list more objects than their models have.
                if not slave.PROFILE or (index, sub) in slave.kept:
                    tool.client.read(slave.node, index, sub)
    machine.clock.at(at, read)


@tempting
def commissioning(machine, dice, at):
    """A technician changes parameters of a node and stores nothing."""
    tool = machine.add_tool(0.5)
    slave = dice.pick(machine.slaves)

    def write():
        for (index, sub), (size, value) in list(slave.objects.items()):
            if index in (0x2100, 0x2101):
                tool.client.read(slave.node, index, sub)
                tool.client.write(slave.node, index, sub, size, (value + 1) % 100)
                tool.client.read(slave.node, index, sub)
    machine.clock.at(at, write)


@tempting
def node_late(machine, dice, at):
    """A node is switched on later than the others, as an attachment is."""
    slave = dice.pick(machine.slaves)
    machine.late = (slave, at)
    machine.master.starts_all = False


@tempting
def mode_change(machine, dice, at):
    """The set points are 0 for a while and the drives stand, as in a change of the operating mode."""
    machine.clock.at(at, lambda: setattr(machine.master, "is_commanding", False))
    machine.clock.at(at + micros(dice.real(2, 6)), lambda: setattr(machine.master, "is_commanding", True))


@tempting
def sensor_at_rest(machine, dice, at):
    """A measured value does not change as long as the machine stands."""
    mode_change(machine, dice, at)
    for slave in machine.slaves:
        if hasattr(slave, "analogue"):
            machine.clock.at(at, lambda slave=slave: slave.analogue.freeze(at))
            machine.clock.at(at + micros(5), lambda slave=slave: setattr(slave.analogue, "frozen", None))


@tempting
def logger_added(machine, dice, at):
    """Another device begins to send its heartbeat on the bus."""
    other = Station(machine.wire, "logger")
    used = {slave.node for slave in machine.slaves} | {machine.master.node}
    node = next(each for each in range(100, 120) if each not in used)

    def begin():
        other.power_on()
        other.send(0x700 + node, [0])
        CyclicTask(other, SECOND, lambda: other.send(0x700 + node, [0x7F]), jitter=500)
    machine.clock.at(at, begin)
