"""Generator of faults, and the figures of the diagnosis.

    python3 tests/faults generate --seeds 1-20 FOLDER            # NNNN.log and its ground truth NNNN.json
    python3 tests/faults score --program target/release/cobscope --seeds 1-500 --table docs/diagnosis-figures.md
    python3 tests/faults score --program … --seeds 1-40 --compare tests/faults/figures.json
    python3 tests/faults score --program … --seeds 7 --list      # one line per capture

Standard library of Python 3.11 only. A seed always gives the same bytes.
"""
import argparse
import collections
import concurrent.futures
import functools
import hashlib
import json
import os
import sys

import invariance
import report
from capture import Scene
from score import answer


def seeds(text):
    """1-40 or 1,5,7."""
    numbers = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        numbers.extend(range(int(first), int(last or first) + 1))
    return numbers


def generate(arguments):
    os.makedirs(arguments.folder, exist_ok=True)
    for seed in seeds(arguments.seeds):
        scene = Scene(seed)
        base = os.path.join(arguments.folder, f"{seed:04}")
        with open(base + ".log", "w", encoding="ascii") as file:
            file.write(scene.text())
        with open(base + ".json", "w", encoding="ascii") as file:
            json.dump(scene.truth(), file, indent=1)
            file.write("\n")


def digest(arguments):
    """Prints the SHA-256 of each capture with its ground truth: a seed always gives the same bytes."""
    for seed in seeds(arguments.seeds):
        scene = Scene(seed)
        content = scene.text() + json.dumps(scene.truth(), sort_keys=True)
        print(seed, scene.family, hashlib.sha256(content.encode()).hexdigest()[:16])


def judged(program, seed):
    return answer(program, Scene(seed))


def line(each):
    truth = each.truth
    return "\t".join(str(cell) for cell in (
        truth["seed"], truth["family"], truth["mode"], truth["second"] or "-", truth["condition"],
        each.evidence if truth["faults"] else "healthy", each.first, "failed" if each.has_failed else "passed",
        each.stories[0]["rules"][:1] if each.stories else "", each.stories[0]["title"] if each.stories else ""))


def score(arguments):
    numbers = seeds(arguments.seeds)
    program = os.path.abspath(arguments.program)
    with concurrent.futures.ProcessPoolExecutor(arguments.jobs) as pool:
        answers = list(pool.map(functools.partial(judged, program), numbers, chunksize=4))
        stability = collections.defaultdict(lambda: [0, 0, 0])
        if arguments.invariance:
            for results in pool.map(functools.partial(invariance.compare, program), seeds(arguments.invariance)):
                for name, (same_cause, same_verdict) in results.items():
                    row = stability[name]
                    row[0], row[1], row[2] = row[0] + 1, row[1] + same_cause, row[2] + same_verdict
    if arguments.list:
        print("\n".join(line(each) for each in answers))
    numbers_now = report.figures(answers)
    if arguments.table:
        command = f"python3 tests/faults score --program cobscope --seeds {arguments.seeds}"
        command += f" --invariance {arguments.invariance}" if arguments.invariance else ""
        write_table(arguments.table, command, report.markdown(answers, stability))
    elif not arguments.list:
        print(report.markdown(answers, stability), end="")
    return compared(arguments, numbers_now)


MARK = "<!-- The rest of this page is written by the command above. -->\n"


def write_table(path, command, tables):
    """Replaces the tables of the page; its introduction stays."""
    with open(path, encoding="utf-8") as file:
        head = file.read().partition(MARK)[0]
    with open(path, "w", encoding="utf-8") as file:
        file.write(f"{head}{MARK}\n`{command}`\n\n{tables}")


def compared(arguments, now):
    """Compares with committed figures; the exit status is 1 if one is worse."""
    if arguments.write:
        with open(arguments.write, "w", encoding="ascii") as file:
            json.dump(now, file, indent=1)
            file.write("\n")
    if not arguments.compare:
        return 0
    with open(arguments.compare, encoding="ascii") as file:
        before = json.load(file)
    names = report.worse(before, now)
    for name in names:
        print(f"{name}: {before[name]:.3f} → {now[name]:.3f}, worse")
    return 1 if names else 0


def main():
    parser = argparse.ArgumentParser(prog="tests/faults", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    writes = commands.add_parser("generate", help="write captures and their ground truth")
    writes.add_argument("--seeds", default="1-20")
    writes.add_argument("folder")
    writes.set_defaults(action=generate)
    digests = commands.add_parser("digest", help="print a digest of each capture")
    digests.add_argument("--seeds", default="1-20")
    digests.set_defaults(action=digest)
    scores = commands.add_parser("score", help="judge a build of the program")
    scores.add_argument("--program", required=True)
    scores.add_argument("--seeds", default="1-40")
    scores.add_argument("--invariance", default="", metavar="SEEDS", help="also compare other views of these seeds")
    scores.add_argument("--table", metavar="FILE", help="write the tables into this page")
    scores.add_argument("--write", metavar="FILE", help="write the figures as JSON")
    scores.add_argument("--compare", metavar="FILE", help="fail if a figure is worse than in this file")
    scores.add_argument("--list", action="store_true", help="print one line per capture")
    scores.add_argument("--jobs", type=int, default=2)
    scores.set_defaults(action=score)
    arguments = parser.parse_args()
    return arguments.action(arguments) or 0


if __name__ == "__main__":
    sys.exit(main())
