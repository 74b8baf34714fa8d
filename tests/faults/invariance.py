"""The same fault seen in another way: the first cause and the verdict must not change."""
import os
import subprocess
import tempfile

from bench import micros
from capture import Scene, options
from recording import candump_text
from score import answer

SHIFT = 3       # added to all node-IDs; keeps the SYDFEC within its 1 to 16


def in_another_format(program, scene):
    """As Vector ASCII, which `convert` writes."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = os.path.join(folder, "capture.log"), os.path.join(folder, "capture.asc")
        with open(source, "w", encoding="ascii") as file:
            file.write(scene.text())
        subprocess.run([program, "convert", source, "-o", target], check=True, capture_output=True)
        with open(target, encoding="ascii") as file:
            return answer(program, scene, text=file.read(), suffix=".asc")


def with_loss(program, scene):
    scene = Scene(scene.seed, condition="loss-1")
    return answer(program, scene)


def from_the_middle(program, scene):
    """Starts 2.5 s before the fault."""
    scene = Scene(scene.seed, condition="plain")
    scene.recording.start = max(scene.recording.start, scene.at - micros(2.5))
    return answer(program, scene)


def with_machine_beside(program, scene):
    """A healthy machine of the same kind on a second bus."""
    other = Scene(scene.seed + 1_000_000, family=scene.family, kind="healthy", mode="nothing", condition="plain")
    begin, shift = scene.recording.start, other.recording.start
    entries = scene.entries() + [(time - shift + begin, "can1", frame) for time, _, frame in other.entries("can1")]
    last = max(time for time, _, _ in scene.entries())
    text = candump_text(sorted((entry for entry in entries if entry[0] <= last), key=lambda entry: entry[0]))
    return answer(program, scene, text, options(scene.truth(), "can0:") + options(other.truth(), "can1:"))


def with_other_numbers(program, scene):
    shifted = Scene(scene.seed, condition="plain", shift=SHIFT)
    return answer(program, shifted)


CHANGES = {"format (Vector ASCII)": in_another_format, "1 % of the frames lost": with_loss,
           "start in the middle": from_the_middle, "a healthy machine beside": with_machine_beside,
           "other node-IDs": with_other_numbers}


def has_same_cause(before, after, shift):
    if before.cause is None or after.cause is None:
        return before.cause == after.cause
    moved = [node + shift for node in before.cause[1]]
    return before.cause[0] == after.cause[0] and before.cause[2] == after.cause[2] and after.cause[1] in (before.cause[1], moved)


def compare(program, seed):
    """Per change: whether first cause and verdict are unchanged."""
    scene = Scene(seed, condition="plain")
    before = answer(program, scene)
    results = {}
    for name, change in CHANGES.items():
        if name == "other node-IDs" and scene.family not in ("canopen", "profiles"):
            continue
        after = change(program, scene)
        shift = SHIFT if name == "other node-IDs" else 0
        results[name] = (has_same_cause(before, after, shift), before.has_failed == after.has_failed)
    return results
