"""What a source keeps, so that it can stand beside a motor: it delays nobody, raises nothing, and turns nothing."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread
from typing import Any

from drivers.clock import Clock, VirtualClock
from drivers.errors import DriverError
from drivers.source import Source, taken_channel
from rig.testing.kept import keep

_TURNS = (
    "drivers.bus",
    "drivers.cycled",
    "drivers.port",
    "rig.run",
    "rig.bench.backends",
    "can",
    "canopen",
)
"""What can send a set-point or a controlword; a source has no business with it."""
_CYCLE_NS = 1_000_000
_PATIENCE_S = 10.0
"""After so long a call counts as one that waits; one that keeps the contract takes microseconds."""


def check_source(
    make: Callable[[Clock], Source], cycles: int = 50, clock: Clock | None = None
) -> None:
    """Raise `AssertionError` with what a source does not keep of its contract.

    `make` gives the source on the clock that it is handed, its line replaced by one of the test; `clock` is that of a
    simulated bench where there is one. It stands still while a call runs: a source that waits by it moves it, and is
    found; one that sleeps is found after ten seconds.
    """
    clock = clock or VirtualClock()
    source = make(clock)
    _check_imports(source)
    told = _in_time("open", lambda: source.open(_CYCLE_NS))
    keep(all(isinstance(text, str) for text in told.values()), "open: says who is there in words")
    _check_channels(source)
    for cycle in range(cycles):
        begun = clock.monotonic_ns()
        _in_time("request", lambda k=cycle: source.request(k))
        keep(clock.monotonic_ns() == begun, "request: waits, and the next SYNC with it")
        until = begun + _CYCLE_NS // 2
        reading = _in_time("collect", lambda k=cycle, u=until: source.collect(k, u))
        keep(clock.monotonic_ns() <= until, "collect: comes back after `until`")
        if reading is not None:
            found, wanted = len(reading.counts), len(source.channels)
            keep(found == wanted, f"collect: {found} counts for {wanted} channels")
            keep(all(type(count) is int for count in reading.counts), "collect: counts are whole")
        list(_in_time("events", source.events))
        clock.wait_until_ns(begun + _CYCLE_NS)
    _in_time("close", source.close)
    _in_time("close, a second time", source.close)


def _check_channels(source: Source) -> None:
    """What it measures has names; a polled channel says beside it when its value was taken."""
    channels = list(source.channels)
    names = [channel.name for channel in channels]
    keep(source.name, "name: is empty")
    keep(names and len(set(names)) == len(names), f"channels: each once, at least one: {names}")
    steps = list(source.largest_steps)
    keep(len(steps) == len(channels), f"largest_steps: {len(steps)} for {len(channels)} channels")
    for channel in channels:
        own = channel.acquired != "polled" or channel.name.endswith("_taken")
        taken = taken_channel(channel).name
        keep(own or taken in names, f"channels: {channel.name} is polled, and {taken} is missing")


def _in_time(what: str, call: Callable[[], Any]) -> Any:
    """What a call returns; an error that it raises, or that it does not come back, is what is not kept."""
    ended: dict[str, Any] = {}

    def run() -> None:
        try:
            ended["value"] = call()
        except BaseException as error:  # noqa: BLE001 - whatever it raises is what is not kept
            ended["error"] = error

    thread = Thread(target=run, daemon=True, name=f"check of {what}")
    thread.start()
    thread.join(_PATIENCE_S)
    keep(not thread.is_alive(), f"{what}: does not come back")
    error = ended.get("error")
    may = what == "open" and isinstance(error, DriverError)
    keep(error is None or may, f"{what}: raises {type(error).__name__}: {error}")
    keep(error is None, f"open: is refused, so nothing more can be checked: {error}")
    return ended["value"]


def _check_imports(source: Source) -> None:
    """Neither its module, nor one of its own package that this imports, imports what can turn a motor."""
    file = inspect.getsourcefile(type(source))
    if file is None:
        return
    module = type(source).__module__
    root = Path(file).parents[module.count(".")]
    waiting, seen = [Path(file)], set[Path]()
    while waiting:
        path = waiting.pop()
        seen.add(path)
        for name in _imported(path):
            wrong = any(name == one or name.startswith(f"{one}.") for one in _TURNS)
            keep(not wrong, f"{path.name}: imports {name}, which can turn the motor")
            if name.partition(".")[0] == module.partition(".")[0]:
                waiting += [one for one in _files_of(root, name) if one not in seen]


def _files_of(root: Path, module: str) -> Iterator[Path]:
    """The file of a module below a folder, where it has one there."""
    place = root / module.replace(".", "/")
    yield from (one for one in (place.with_suffix(".py"), place / "__init__.py") if one.is_file())


def _imported(path: Path) -> Iterator[str]:
    """The modules that a file imports, and what it takes out of them."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
