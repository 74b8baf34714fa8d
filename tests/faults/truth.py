"""The ground truth of a capture: component, failure mode, time, and which evidence the capture contains."""
from bench import SECOND


class Fault:
    """One fault. `component` is node, group, wire, controller, sync, process, tool, client, server or recorder.

    `start` and `end` are the time of the fault; `end` None: until the end. The evidence is complete if the capture covers
    `first` to `last`. `modes` are all modes that describe it correctly, the exact one first. `effects` are nodes that only
    suffer from it.
    """

    def __init__(self, component, modes, start, nodes=(), end=None, before=2.0, after=4.0, effects=(), severity="",
                 needs_errors=False, from_boot=False):
        self.component, self.modes = component, [modes] if isinstance(modes, str) else list(modes)
        self.nodes, self.start, self.end = list(nodes), start, end
        self.first = 0 if from_boot else max(0, start - round(before * SECOND))
        self.last = (end if end is not None else start) + round(after * SECOND)
        self.effects, self.severity, self.needs_errors = list(effects), severity, needs_errors

    def evidence(self, recording):
        """whole, part or none."""
        if self.end is not None and self.end < recording.start or self.start > recording.end:
            return "none"
        whole = recording.start <= self.first and recording.end >= self.last
        return "whole" if whole and (recording.has_errors or not self.needs_errors) else "part"

    def as_dict(self, recording):
        def seconds(time):
            return None if time is None else round((time - recording.start) / SECOND, 6)
        return {"component": self.component, "nodes": self.nodes, "mode": self.modes[0], "also_right": self.modes[1:],
                "start": seconds(self.start), "end": seconds(self.end), "severity": self.severity, "effects": self.effects,
                "evidence": self.evidence(recording)}
