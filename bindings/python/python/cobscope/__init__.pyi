"""Types of the module; `__init__.py` and the classes have the descriptions."""

import datetime
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypedDict

from typing_extensions import Unpack

__version__: str

_Path = str | os.PathLike[str]

class _Options(TypedDict, total=False):
    node: Mapping[int | str, str] | None
    eds: Mapping[int | str, _Path] | None
    dbc: _Path | Sequence[_Path] | None
    bus: _Path | None
    profiles: _Path | Sequence[_Path] | None
    protocol: str | None
    join: bool
    separate: bool
    part_gap: float | None
    time: str | None
    columns: str | None
    time_unit: str | None
    sdo_timeout: float | None
    select: str | Sequence[str] | None
    ignore: str | Sequence[str] | None
    today: str | datetime.date | None

class Error(Exception):
    place: str | None
    reason: str

class ArgumentError(Error): ...
class ProfileError(Error): ...
class CaptureError(Error): ...

class Rows:
    def __iter__(self) -> Rows: ...
    def __next__(self) -> dict[str, Any]: ...

class Table:
    columns: list[str]
    def __iter__(self) -> Iterator[dict[str, Any]]: ...
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...
    def __arrow_c_schema__(self) -> object: ...

class Capture:
    name: str
    parts: list[str]
    warnings: list[str]
    def events(self, filter: str | None = None, *, rules: bool = True) -> Table: ...
    def signals(self, filter: str | None = None) -> Table: ...
    def frames(self) -> Table: ...
    def findings(self) -> Table: ...
    def stories(self) -> Table: ...
    def objects(self) -> Table: ...
    def statistics(self) -> dict[str, Any]: ...

class CheckResult:
    findings: Table
    captures: list[dict[str, Any]]
    total: dict[str, Any]
    warnings: list[str]
    @property
    def fails(self) -> bool: ...

class Decoder:
    on_event: Callable[[dict[str, Any]], object] | None
    frames: int
    dropped: tuple[int, int]
    warnings: list[str]
    def __init__(
        self, *, on_event: Callable[[dict[str, Any]], object] | None = None, **options: Unpack[_Options]
    ) -> None: ...
    def __call__(self, message: Any) -> None: ...
    def on_message_received(self, message: Any) -> None: ...
    def on_error(self, error: Exception) -> None: ...
    def stop(self) -> None: ...
    def push(
        self,
        timestamp: float | None,
        id: int,
        data: bytes | None = None,
        *,
        bus: str = "can0",
        extended: bool = False,
        remote: bool = False,
        error: bool = False,
        fd: bool = False,
        brs: bool = False,
        esi: bool = False,
        transmitted: bool = False,
        length: int | None = None,
    ) -> None: ...
    def advance(self, timestamp: float) -> None: ...
    def events(self) -> Table: ...
    def signals(self) -> Table: ...
    def finish(self) -> Table: ...

def open(
    path: _Path | Sequence[_Path], *, incomplete: bool = False, **options: Unpack[_Options]
) -> Capture: ...
def check(
    paths: _Path | Sequence[_Path],
    *,
    fail_on: str = "error",
    threads: int | None = None,
    baseline: _Path | None = None,
    **options: Unpack[_Options],
) -> CheckResult: ...
def diff(
    good: _Path,
    bad: _Path,
    *,
    only: str | Sequence[str] | None = None,
    at_event: str | None = None,
    start: str | None = None,
    end: str | None = None,
    **options: Unpack[_Options],
) -> dict[str, Any]: ...
def explain(
    thing: str | int, *, device: str | None = None, profiles: _Path | Sequence[_Path] | None = None
) -> str: ...
