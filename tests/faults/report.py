"""Tables of figures, as Markdown and as numbers that a test compares."""
from score import COMPONENT, NOTHING, RIGHT, UNKNOWN, WRONG, tally


def share(count, total):
    return f"{100 * count / total:.0f} %" if total else "-"


def row_of(name, row):
    total = row["n"]
    cells = [name, str(total)] + [share(row[key], total) for key in (RIGHT, "in_three", COMPONENT, UNKNOWN, NOTHING, WRONG)]
    return "| " + " | ".join(cells) + " |"


HEAD = ["| {} | captures | right | in the first three | component only | unknown | nothing | wrong |", "| --- |" + " ---: |" * 7]


def table(title, rows):
    lines = [HEAD[0].format(title), HEAD[1]]
    return lines + [row_of(name, rows[name]) for name in sorted(rows)]


def split(answers):
    faulty = [each for each in answers if each.truth["faults"]]
    whole = [each for each in faulty if each.evidence == "whole"]
    healthy = [each for each in answers if not each.truth["faults"]]
    return faulty, whole, healthy


def healthy_table(title, answers, key):
    lines = [f"| {title} | captures | with a story | failed |", "| --- | ---: | ---: | ---: |"]
    for name in sorted({key(each) for each in answers}):
        some = [each for each in answers if key(each) == name]
        lines.append(f"| {name} | {len(some)} | {sum(bool(each.stories) for each in some)} | {sum(each.has_failed for each in some)} |")
    return lines


def condition(each):
    return each.truth["condition"]


def mode(each):
    family = "canopen" if each.truth["family"] == "profiles" else each.truth["family"]
    return f"{family}: {each.truth['mode']}"


def figures(answers):
    """Numbers for the comparison; each is a share of captures, 0 to 1."""
    faulty, whole, healthy = split(answers)
    count = max(1, len(whole))
    return {
        "captures": len(answers), "whole": len(whole), "healthy": len(healthy),
        "right": sum(each.first == RIGHT for each in whole) / count,
        "component": sum(each.first in (RIGHT, COMPONENT) for each in whole) / count,
        "in_three": sum(each.in_three for each in whole) / count,
        "wrong": sum(each.first == WRONG for each in whole) / count,
        "false_stories": sum(bool(each.stories) for each in healthy) / max(1, len(healthy)),
        "false_failures": sum(each.has_failed for each in healthy) / max(1, len(healthy)),
        "hidden_wrong": sum(each.first == WRONG for each in faulty if each.evidence == "none"),
    }


MORE_IS_BETTER = ("right", "component", "in_three")
LESS_IS_BETTER = ("wrong", "false_stories", "false_failures", "hidden_wrong")


def worse(before, now):
    """Names of figures that are worse than before."""
    tolerance = 1e-9
    names = [name for name in MORE_IS_BETTER if now[name] < before[name] - tolerance]
    return names + [name for name in LESS_IS_BETTER if now[name] > before[name] + tolerance]


def markdown(answers, stability):
    """The tables of a run."""
    faulty, whole, healthy = split(answers)
    all_rows = tally(whole, lambda each: "evidence complete")
    all_rows.update(tally([each for each in faulty if each.evidence == "part"], lambda each: "evidence in part"))
    all_rows.update(tally([each for each in faulty if each.evidence == "none"], lambda each: "no evidence"))
    lines = table("faulty machines", all_rows)
    lines += ["", *healthy_table("healthy machines", healthy, lambda each: "all")]
    lines += ["", "## By family, evidence complete", "", *table("family", tally(whole, lambda each: each.truth["family"]))]
    double = tally(whole, lambda each: each.truth["kind"])
    lines += ["", "## Single and double faults, evidence complete", "", *table("faults", double)]
    lines += ["", "## By condition of the recording, evidence complete or in part", ""]
    lines += table("condition", tally([each for each in faulty if each.evidence != "none"], condition))
    lines += ["", *healthy_table("condition, healthy machines", healthy, condition)]
    lines += ["", "## By failure mode, single faults, evidence complete", ""]
    lines += table("failure mode", tally([each for each in whole if each.truth["kind"] == "single"], mode))
    lines += ["", "## By behaviour of healthy machines", ""]
    lines += healthy_table("behaviour", healthy, mode)
    if stability:
        lines += ["", "## Invariance", "", "| change | captures | same first cause | same verdict |", "| --- | ---: | ---: | ---: |"]
        for name, (count, same_cause, same_verdict) in stability.items():
            lines.append(f"| {name} | {count} | {share(same_cause, count)} | {share(same_verdict, count)} |")
    return "\n".join(lines) + "\n"
