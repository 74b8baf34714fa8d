#!/usr/bin/env python3
"""Draws the screen of the program in a terminal as SVG.

    python3 docs/screenshot.py target/release/cobscope docs/screenshot.svg

The program runs in tmux, which returns its screen with colours. Capture and keys are below.
"""

import html
import re
import subprocess
import sys
import time

CAPTURE = ["view", "--node", "32=danfoss-pve-ci", "fixtures/devices/pve.log"]
KEYS = ["p"]
SIZE = (168, 46)
CELL = (8.4, 17)
BACKGROUND, FOREGROUND = "#16181d", "#d8dbe2"
BASE = ["#16181d", "#e06c75", "#98c379", "#e5c07b", "#61afef", "#c678dd", "#56b6c2", "#abb2bf",
        "#5c6370", "#ff7a85", "#b5e08c", "#ffd68a", "#7cc4ff", "#de8cf2", "#6fd3e0", "#ffffff"]


def color(index):
    """A colour of the 256-colour palette of xterm."""
    if index < 16:
        return BASE[index]
    if index < 232:
        parts = [(index - 16) // 36, (index - 16) // 6 % 6, (index - 16) % 6]
        return "#" + "".join(f"{0 if part == 0 else 55 + 40 * part:02x}" for part in parts)
    return "#" + f"{8 + 10 * (index - 232):02x}" * 3


def tmux(*words):
    return subprocess.run(["tmux", "-L", "screenshot", *words], check=True, capture_output=True, text=True).stdout


def wait(text):
    """Waits until the screen contains a text, max 10 s."""
    for _ in range(100):
        if text in tmux("capture-pane", "-p"):
            return
        time.sleep(0.1)
    raise SystemExit(f"{text!r} did not appear")


def screen(program):
    words = ["env", "TERM=xterm-256color", "COLORTERM=truecolor", program, *CAPTURE]
    tmux("new-session", "-d", "-x", str(SIZE[0]), "-y", str(SIZE[1]), " ".join(words))
    try:
        # The cursor is at the first story.
        wait("#104/190")
        time.sleep(1)
        for key in KEYS:
            tmux("send-keys", key)
            time.sleep(1)
        return tmux("capture-pane", "-p", "-e").splitlines()
    finally:
        tmux("kill-server")


def runs(line):
    """Parts of a line with their style: foreground, background, bold, reversed."""
    style = {"fg": None, "bg": None, "bold": False, "dim": False, "reverse": False}
    for code, text in re.findall(r"\x1b\[([0-9;]*)m|([^\x1b]+)", line):
        if text:
            yield dict(style), text
            continue
        codes = [int(part or 0) for part in code.split(";")]
        while codes:
            first = codes.pop(0)
            if first == 0:
                style = {"fg": None, "bg": None, "bold": False, "dim": False, "reverse": False}
            elif first in (1, 2, 7):
                style[{1: "bold", 2: "dim", 7: "reverse"}[first]] = True
            elif first in (38, 48) and codes[:1] == [5]:
                style["fg" if first == 38 else "bg"] = color(codes[1])
                codes = codes[2:]
            elif first in (39, 49):
                style["fg" if first == 39 else "bg"] = None
            elif 30 <= first <= 37 or 90 <= first <= 97:
                style["fg"] = color(first - 30 if first < 90 else first - 82)
            elif 40 <= first <= 47:
                style["bg"] = color(first - 40)


def draw(lines):
    width, height = SIZE[0] * CELL[0] + 20, SIZE[1] * CELL[1] + 20
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
             f'font-family="DejaVu Sans Mono, Menlo, Consolas, monospace" font-size="14">',
             f'<rect width="100%" height="100%" rx="6" fill="{BACKGROUND}"/>']
    for row, line in enumerate(lines):
        column = 0
        for style, text in runs(line):
            front, back = style["fg"] or FOREGROUND, style["bg"]
            if style["reverse"]:
                front, back = back or BACKGROUND, front
            x, y = 10 + column * CELL[0], 10 + row * CELL[1]
            wide = len(text) * CELL[0]
            if back:
                parts.append(f'<rect x="{x:.1f}" y="{y}" width="{wide:.1f}" height="{CELL[1]}" fill="{back}"/>')
            if text.strip():
                weight = ' font-weight="bold"' if style["bold"] else ""
                weight += ' opacity="0.6"' if style["dim"] else ""
                parts.append(f'<text x="{x:.1f}" y="{y + 13}" textLength="{wide:.1f}" xml:space="preserve" '
                             f'fill="{front}"{weight}>{html.escape(text)}</text>')
            column += len(text)
    return "\n".join([*parts, "</svg>", ""])


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    with open(sys.argv[2], "w", encoding="utf-8") as out:
        out.write(draw(screen(sys.argv[1])))
