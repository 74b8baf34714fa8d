"""Judges `cobscope why` and `check` against the ground truth by typed fields: rule, node, component, mode."""
import collections
import json
import os
import subprocess
import tempfile
import tomllib

from capture import Scene, options

HERE = os.path.dirname(os.path.abspath(__file__))
with open(os.path.join(HERE, "claims.toml"), "rb") as file:
    CLAIMS = tomllib.load(file)

# Judgements of the first story, best first.
RIGHT, COMPONENT, UNKNOWN, NOTHING, WRONG = "right", "component", "unknown", "nothing", "wrong"
JUDGEMENTS = [RIGHT, COMPONENT, UNKNOWN, NOTHING, WRONG]


def run(program, command, path, more):
    """Standard output and exit status of a command."""
    done = subprocess.run([program, command, *more, path], capture_output=True, text=True, timeout=120, check=False)
    if done.returncode > 1:
        raise RuntimeError(f"{command} {path}: status {done.returncode}: {done.stderr[:400]}")
    return done.stdout, done.returncode


def claim(story):
    """Component, nodes and modes that a story names, and whether it names a cause."""
    nodes = {story["node"]} if story.get("node") is not None else set()
    if story.get("component"):
        nodes |= set(story["nodes"])
        modes = [story["mode"]] if story.get("mode") else []
        return story["component"], nodes, modes, bool(story.get("mode"))
    rule = story["rules"][0] if story.get("rules") else ""
    row = CLAIMS["rule"].get(rule) or CLAIMS["device"].get(rule.rpartition(":")[2]) or {"component": "node", "modes": []}
    return row["component"], nodes, row["modes"], story["cause_visible"]


def judge(story, faults):
    """The best judgement of a story over all faults of the capture."""
    component, nodes, modes, is_specific = claim(story)
    best = WRONG if is_specific else UNKNOWN
    for fault in faults:
        is_same = fault["component"] in CLAIMS["same"].get(component, [component])
        owned = set(fault["nodes"])
        if fault["component"] == "group" or component == "group":
            # One node of a group is not the cause: two at least must be named.
            has_node = len(owned & nodes) >= 2 or not nodes
        else:
            has_node = not owned or bool(owned & nodes) or (not nodes and component != "node")
        if fault["component"] in ("sync", "controller", "client", "recorder", "wire") and is_same:
            has_node = True
        if is_same and has_node:
            if set(modes) & {fault["mode"], *fault["also_right"]}:
                return RIGHT
            best = COMPONENT
    return best


class Answer:
    """What the program prints about one capture, judged."""

    def __init__(self, truth, why, has_failed, findings):
        self.truth, self.has_failed, self.findings = truth, has_failed, findings
        self.stories = why["stories"]
        judgements = [judge(story, truth["faults"]) for story in self.stories]
        self.first = judgements[0] if judgements else NOTHING
        self.in_three = RIGHT in judgements[:3]
        self.cause = (claim(self.stories[0])[0], sorted(claim(self.stories[0])[1]), self.stories[0]["rules"][:1]) if self.stories else None

    @property
    def evidence(self):
        """The best evidence of all faults of the capture."""
        grades = [fault["evidence"] for fault in self.truth["faults"]]
        return next((grade for grade in ("whole", "part", "none") if grade in grades), "none")


def answer(program, scene, text=None, more=None, suffix=".log"):
    """Runs the program on a scene; `text` replaces the capture, `more` the options."""
    truth = scene.truth()
    assigned = options(truth) if more is None else more
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "capture" + suffix)
        with open(path, "w", encoding="ascii") as file:
            file.write(scene.text() if text is None else text)
        why, _ = run(program, "why", path, ["-f", "json", *assigned])
        check, status = run(program, "check", path, ["-f", "jsonl", *assigned])
    findings = [json.loads(line) for line in check.splitlines() if line.startswith("{")]
    findings = [finding for finding in findings if finding.get("severity") in ("error", "warning") and "rule" in finding]
    return Answer(truth, json.loads(why.splitlines()[0]), status == 1, findings)


def tally(answers, key):
    """Counts of judgements by a key of an answer."""
    rows = collections.defaultdict(collections.Counter)
    for each in answers:
        row = rows[key(each)]
        row["n"] += 1
        row[each.first] += 1
        row["in_three"] += each.in_three
    return rows
