"""One capture of a seed: machine, faults or tempting behaviour, recording conditions and the ground truth."""
import canopen_faults
import canopen_healthy
import j1939_machine
import uds_machine
from bench import SECOND, Dice, micros
from canopen_machine import CanopenMachine
from recording import Recording, candump_text

FAMILIES = {
    "canopen": (lambda dice, shift: CanopenMachine(dice, False, shift), canopen_faults.MODES, canopen_healthy.TEMPTING),
    "profiles": (lambda dice, shift: CanopenMachine(dice, True, shift), canopen_faults.MODES, canopen_healthy.TEMPTING),
    "j1939": (lambda dice, _shift: j1939_machine.J1939Machine(dice), j1939_machine.MODES, j1939_machine.TEMPTING),
    "uds": (lambda dice, _shift: uds_machine.UdsMachine(dice), uds_machine.MODES, uds_machine.TEMPTING),
}
# Weights in 20: families, kinds of capture, conditions of the recording.
FAMILY_WEIGHTS = ["canopen"] * 7 + ["profiles"] * 6 + ["j1939"] * 5 + ["uds"] * 2
KIND_WEIGHTS = ["healthy"] * 5 + ["single"] * 12 + ["double"] * 3
CONDITIONS = ["plain"] * 8 + ["loss-0.1"] + ["loss-0.5"] + ["loss-1"] * 2 + ["loss-2"] + ["late-start"] * 2 + ["cut-end"] \
    + ["no-error-frames"] * 2 + ["coarse-clock"] + ["usb-clock"]


class Scene:
    """What a seed stands for. All parts can be fixed, which the comparisons of conditions use."""

    def __init__(self, seed, family=None, kind=None, condition=None, mode=None, shift=0):
        dice = Dice(f"scene {seed}")
        self.seed, self.shift = seed, shift
        self.family = family or dice.pick(FAMILY_WEIGHTS)
        self.kind = kind or dice.pick(KIND_WEIGHTS)
        self.condition = condition or dice.pick(CONDITIONS)
        make, modes, tempting = FAMILIES[self.family]
        self.mode = mode or (dice.pick(list(tempting)) if self.kind == "healthy" else dice.pick(list(modes)))
        self.second = dice.pick(list(modes)) if self.kind == "double" else None
        # A machine without the part that fails is drawn again.
        for attempt in range(40):
            if self.draw(make, modes, tempting, Dice(f"machine {seed} {attempt}")):
                break
        else:
            self.mode, self.second = "node-silent" if "node-silent" in modes else next(iter(modes)), None
            self.draw(make, modes, tempting, Dice(f"machine {seed} last"))

    def draw(self, make, modes, tempting, dice):
        self.machine = make(dice, self.shift)
        machine = self.machine
        begins_at_power = dice.chance(0.5)
        at = machine.settled + micros(dice.real(3, 7))
        end = at + micros(dice.real(9, 15))
        self.faults = []
        if self.kind == "healthy":
            tempting[self.mode](machine, dice, at)
            self.at = at
        else:
            for name, time in ((self.mode, at), (self.second, at + micros(dice.real(0, 4)))):
                fault = modes[name](machine, dice, time) if name else None
                if name and not fault:
                    return False
                if fault:
                    self.faults.append(fault)
            self.at = self.faults[0].start
            end = max([end] + [fault.last + SECOND // 2 for fault in self.faults])
            begins_at_power = begins_at_power or any(fault.first == 0 for fault in self.faults)
        start = 0 if begins_at_power else machine.settled
        self.recording = self.conditions(Dice(f"recording {self.seed}"), start, end)
        machine.power_on()
        machine.clock.run(self.recording.end + SECOND // 10)
        return True

    def conditions(self, dice, start, end):
        recording = Recording(dice, start, end)
        recording.condition = self.condition
        if self.condition.startswith("loss-"):
            recording.loss = float(self.condition[5:]) / 100
        elif self.condition == "late-start":
            delay = dice.real(0.5, 3) if self.kind != "healthy" else -dice.real(1, 3)
            recording.start = self.at + micros(delay)
        elif self.condition == "cut-end":
            recording.end = self.at + micros(dice.real(0.3, 1.5))
        elif self.condition == "no-error-frames":
            recording.has_errors = False
        elif self.condition == "coarse-clock":
            recording.clock = "coarse"
        elif self.condition == "usb-clock":
            recording.clock = "usb"
        recording.overflows = self.machine.overflows
        return recording

    def entries(self, bus="can0"):
        return self.recording.stored(self.machine.wire.frames, bus)

    def text(self):
        return candump_text(self.entries())

    def truth(self):
        machine = self.machine
        return {"seed": self.seed, "family": self.family, "kind": self.kind, "condition": self.condition,
                "mode": self.mode, "second": self.second, "machine": machine.description(), "profiles": machine.profiles(),
                "faults": [fault.as_dict(self.recording) for fault in self.faults]}


def options(truth, bus=""):
    """Command-line options that assign the profiles of the machine; `bus` as "can0:"."""
    return [part for node, profile in truth["profiles"].items() for part in ("--node", f"{bus}{node}={profile}")]
