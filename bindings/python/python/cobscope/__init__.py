"""Reads CAN captures and live CAN frames: events, values and findings of CANopen, J1939 and UDS devices.

    import cobscope

    capture = cobscope.open("run.log", node={2: "rexroth-sydfec"})
    for finding in capture.findings():
        print(finding["severity"], finding["text"])
    frame = polars.DataFrame(capture.signals())

Tables are Arrow streams (polars, pandas, DuckDB and pyarrow read them without copies) and iterators of rows. The columns
are those of `cobscope decode -f parquet`.
"""

import json as _json

from . import _cobscope
from ._cobscope import ArgumentError, Capture, CaptureError, Error, ProfileError, Rows, Table, __version__
from ._live import Decoder
from ._options import words as _words, words_of_captures as _words_of_captures

__all__ = [
    "ArgumentError",
    "Capture",
    "CaptureError",
    "CheckResult",
    "Decoder",
    "Error",
    "ProfileError",
    "Rows",
    "Table",
    "__version__",
    "check",
    "diff",
    "explain",
    "open",
]


def open(path, *, incomplete=False, **options):
    """Opens a capture: a file, a list of the parts of one capture, or a folder with them.

    Options, as on the command line:

    node        profiles of nodes: {2: "rexroth-sydfec", "can1:5": "my-device", "sa:0x80": "danfoss-pve-ci"}
    eds         EDS, DCF, XDD or XDC of nodes: {5: "pump.eds"}
    dbc         a DBC or pretty_j1939 file, or a list; the first one takes precedence
    bus         a bus file (TOML): names, bit rates, devices, expectations
    profiles    a folder with profiles and device files, or a list
    protocol    "auto", "canopen", "j1939" or "none"
    join, separate, part_gap    how files are joined to one capture
    time        "absolute" or "delta", for ambiguous times of candump text
    columns     columns of text captures, such as "time:ms id len data"
    time_unit   "s", "ms", "us" or "ns", for times in CSV
    time_zone   time zone of a recorder that stores local times, such as "Europe/Berlin"
    sdo_timeout seconds after which an SDO transfer counts as unanswered
    select, ignore              rules to check with, or without
    today       date for suppressions that expire, such as "2026-01-31"

    incomplete: a truncated capture is a warning in place of an error after its last row.

    Raises ArgumentError, ProfileError or CaptureError.
    """
    return Capture._open(_words_of_captures(path, options), incomplete)


class CheckResult:
    """Verdicts of `check`."""

    def __init__(self, text, findings, warnings, exit_status):
        lines = [_json.loads(line) for line in text.splitlines()]
        #: Findings of all captures, a Table.
        self.findings = findings
        #: One dictionary per capture: verdict, counts, rules.
        self.captures = [line for line in lines if line["kind"] == "summary"]
        #: Counts of all captures.
        self.total = next((line for line in lines if line["kind"] == "total"), {})
        #: Warnings, such as unreadable lines.
        self.warnings = warnings
        self._exit_status = exit_status

    @property
    def fails(self):
        """Whether `cobscope check` ends with an error: a finding at or above `fail_on`, an unreadable capture, or none at all."""
        return self._exit_status != 0

    def __repr__(self):
        verdicts = ", ".join(f"{capture['capture']}: {capture['verdict']}" for capture in self.captures)
        return f"<cobscope.CheckResult {verdicts}>"


def check(paths, *, fail_on="error", threads=None, baseline=None, **options):
    """Checks captures, or all captures in folders, against all rules; several in parallel.

    Options are those of `open`, and: fail_on "error", "warning", "note" or "never"; threads; baseline, a file with
    accepted findings. A capture that cannot be read is a verdict, not an exception.
    """
    options = dict(options, fail_on=fail_on, threads=threads, baseline=baseline)
    return CheckResult(*_cobscope.check(_words_of_captures(paths, options)))


def diff(good, bad, *, only=None, at_event=None, start=None, end=None, **options):
    """Compares two captures, most important differences first.

    Returns the object of `cobscope diff -f json` (docs/diff.schema.json). Options are those of `open`, and: only, a list of
    sections; at_event, a filter for the event from which steps are compared; start and end, such as "12.5" or "#1234".
    """
    options = dict(options, only=only, at_event=at_event)
    options.update({"from": start, "to": end})
    text, warnings = _cobscope.diff(_words([good, bad], options))
    result = _json.loads(text)
    result["warnings"] = warnings
    return result


def explain(thing, *, device=None, profiles=None):
    """Explains a code, an identifier, an object, a frame or a rule: "06090031", "5208:02", "701#05", "node-lost".

    device: the profile to look it up in. Raises ArgumentError for a text without a meaning.
    """
    return _cobscope.explain(_words(str(thing), {"device": device, "profiles": profiles}))


def _statistics(self):
    """Counts and times of nodes and messages, as `cobscope stats -f json`."""
    return _json.loads(self._statistics())


Capture.statistics = _statistics
