"""Options of the functions as words of a command line, so that both have the same checks and errors."""

import os

from ._cobscope import ArgumentError

#: Options of several values, each with its own word.
_LISTS = ("dbc", "profiles", "only", "select", "ignore")
#: Options without a value.
_FLAGS = ("join", "separate")
_OTHERS = (
    "bus", "protocol", "part_gap", "time", "time_unit", "time_zone", "columns", "sdo_timeout", "today", "fail_on", "threads", "baseline", "at_event", "from", "to",
    "device",
)


def _text(value):
    return os.fsdecode(value) if isinstance(value, (bytes, os.PathLike)) else str(value)


def _all(value):
    return [value] if isinstance(value, (str, bytes, os.PathLike)) else list(value)


def words(paths, options):
    """The words; options that are None are omitted, and without paths the command reads no capture.

    Raises TypeError for an unknown option.
    """
    result = []
    paths = [] if paths is None else _all(paths)
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if name not in ("node", "eds", *_LISTS, *_FLAGS, *_OTHERS):
            raise TypeError(f"unknown option {name!r}")
        if value is None or value is False:
            continue
        if name in ("node", "eds"):
            result += [f"{option}={node}={_text(of)}" for node, of in value.items()]
        elif name in _LISTS:
            result += [f"{option}={_text(one)}" for one in _all(value)]
        elif name in _FLAGS:
            result.append(option)
        else:
            result.append(f"{option}={_text(value)}")
    # A name that starts with - is a file, not an option.
    return [*result, "--", *map(_text, paths)]


def words_of_captures(paths, options):
    """The words for at least one capture: the command would read standard input without one.

    Raises ArgumentError for an empty list of paths.
    """
    if not _all(paths):
        error = ArgumentError("no capture")
        error.place, error.reason = None, "no capture"
        raise error
    return words(paths, options)
