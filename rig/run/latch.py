"""The latch of a trip: a file in the state folder of the bench (for a simulated rig the folder of
its runs) that refuses the next run until somebody acknowledges it by name. The marker of a run that
was cut off in motion (`rig.run.marker`) is a latch as well: nothing was alive to leave another one.

The first cause stays: a later trip does not replace it. There is no automatic restart, not even of
the program: the latch outlives the process. Every acknowledgement is appended to
`acknowledged-trips.jsonl`, which is never edited.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rig.bench.held import synchronise_folder
from rig.bench.identity import Bench
from rig.errors import RigError
from rig.run.marker import Orphan, boot_id, orphans

LATCH_NAME = ".tripped.json"
HISTORY_NAME = "acknowledged-trips.jsonl"
CUT_OFF = "cut_off_in_motion"
"""The cause of a latch that is an orphaned marker."""


class LatchedTripError(RigError):
    """A run was asked for while the trip of an earlier one has not been acknowledged."""


@dataclass(frozen=True, slots=True)
class LatchedTrip:
    """What tripped: cause, run, time (ISO 8601 with zone), the message, and whether standstill was
    verified. Of a run that was cut off, `part` is the file that it left.
    """

    cause: str
    run: str
    time: str
    message: str
    standstill_verified: bool
    part: str = ""


class TripLatch:
    """The latch of one bench: written in `folder`, and obeyed as well where it lies `elsewhere`.

    `option` is what names the bench to `rig acknowledge`. `bench` is the identity of one that a run has
    for itself: no marker in its folder can be that of a run beside it, and elsewhere only its own count.
    """

    def __init__(
        self,
        folder: Path,
        elsewhere: Sequence[Path] = (),
        option: str = "",
        *,
        bench: str = "",
    ) -> None:
        self.folder = folder
        self.path = folder / LATCH_NAME
        self._places = (folder, *elsewhere)
        self._option = option or f"--runs {folder}"
        self._bench = bench

    def read(self) -> LatchedTrip | None:
        """The trip that is latched, None when there is none. A latch that cannot be read still counts as one."""
        return self._latched()[1]

    def _latched(self, alone: bool = False) -> tuple[Path, LatchedTrip | None]:
        """Where a trip is latched, and the trip; the bench's own place first."""
        return next(self._all(alone), (self.path, None))

    def _all(self, alone: bool) -> Iterator[tuple[Path, LatchedTrip]]:
        for place in self._places:
            trip = _trip_in(place / LATCH_NAME)
            if trip is not None:
                yield place / LATCH_NAME, trip
            is_own = place == self.folder
            for orphan in orphans(place, alone=alone and is_own):
                if is_own or (orphan.run is not None and orphan.run.bench == self._bench):
                    yield orphan.path, _cut_off(orphan)

    def refuse(self) -> None:
        """Raise `LatchedTripError` while a trip is latched. Asked by whoever is about to run on the bench."""
        path, trip = self._latched(alone=bool(self._bench))
        if trip is None:
            return
        unsafe = ". Standstill was NOT verified: look at the rig before anything else"
        if trip.standstill_verified:
            unsafe = ""
        told = f" ({trip.message})" if trip.cause == CUT_OFF else ""
        raise LatchedTripError(
            f"a trip has not been acknowledged; nothing turns before it is{unsafe}",
            where=str(path.parent),
            value=f"{trip.cause} in run {trip.run}, {trip.time}{told}",
            remedy=f"Find and remove the cause, then: rig acknowledge --operator NAME {self._option}",
        )

    def leave(self, trip: LatchedTrip) -> None:
        """Latch a trip; one that is latched already stays. Raises `RigError` when it cannot be written."""
        text = json.dumps(asdict(trip), indent=2) + "\n"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            # "x": whoever comes second leaves the first cause as it is, without a look before the leap.
            with self.path.open("x", encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            synchronise_folder(self.folder)
        except OSError as error:
            if isinstance(error, FileExistsError) and self.path.exists():
                return
            raise RigError(
                f"the trip could not be latched: {error.strerror or error}",
                where=str(self.path),
                remedy="Do not run again before the cause has been found.",
            ) from error

    def acknowledge(self, operator: str, time: str, remark: str = "") -> LatchedTrip:
        """Release the latch in the name of an operator, and keep who it was. Raises `RigError` without trip or name."""
        name = operator.strip()
        if not name:
            raise RigError(
                "a trip is acknowledged by name",
                where="--operator",
                remedy="Say who acknowledges it.",
            )
        path, trip = self._latched()
        if trip is None:
            raise RigError(
                "no trip is latched here",
                where=str(self.folder),
                remedy="Name the folder with --runs, or a rig of hardware with --config.",
            )
        entry = {**asdict(trip), "acknowledged_by": name, "acknowledged_at": time, "remark": remark}
        try:
            with (path.parent / HISTORY_NAME).open("a", encoding="utf-8") as file:
                file.write(json.dumps(entry) + "\n")
            for latched, other in [(path, trip), *self._all(alone=False)]:
                # A run whose standstill was not verified leaves both, trip and marker: one cause, one name.
                if latched == path or (other.part and other.run == trip.run and not trip.part):
                    latched.unlink(missing_ok=True)
        except OSError as error:
            raise RigError(
                f"the latch cannot be released: {error.strerror or error}", where=str(path.parent)
            ) from error
        return trip


def latch_of(bench: Bench) -> TripLatch:
    """The latch of a bench."""
    identity = bench.id if bench.has_one_master else ""
    return TripLatch(bench.state, bench.elsewhere, bench.option, bench=identity)


def _cut_off(orphan: Orphan) -> LatchedTrip:
    """What an orphaned marker tells: which run, when, how, and the file that it left."""
    marked = orphan.run
    if marked is None:
        return LatchedTrip(CUT_OFF, "unknown", "", f"{orphan.path} cannot be read", False)
    restarted = marked.boot != boot_id()
    how = "the computer was started anew since" if restarted else "it was killed"
    text = (
        f"process {marked.process} ({marked.protocol}) ended while the rig may have been in motion, "
        f"before standstill was verified: {how}; what it recorded is in {marked.part}"
    )
    return LatchedTrip(CUT_OFF, marked.run, marked.time, text, False, marked.part)


def _trip_in(path: Path) -> LatchedTrip | None:
    """The trip that a file tells; None where there is none."""
    try:
        content: dict[str, Any] | None = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError):
        return LatchedTrip("unknown", "unknown", "", f"{path} cannot be read", False)
    fields = content if isinstance(content, dict) else {}
    cause, run, time, message = (
        str(fields.get(name, "unknown")) for name in ("cause", "run", "time", "message")
    )
    return LatchedTrip(cause, run, time, message, bool(fields.get("standstill_verified", False)))
