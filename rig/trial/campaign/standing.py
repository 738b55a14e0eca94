"""What of an unfinished campaign still counts: the same bench and gear, sealed files, a tare that is young.

A run that does not count any more is made again; the campaign goes on after what does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import catalogue
from rig.analysis.tare import tare_days_of, tare_kind
from rig.errors import ConfigurationError, RigError
from rig.gears.card import card_for
from rig.gears.card_places import from_cards
from rig.library.index import LibraryIndex
from rig.runfile.seal import check_seal

if TYPE_CHECKING:
    from rig.trial.campaign.journal import DoneStage, Journal
    from rig.trial.campaign.plan import CampaignPlan

_MOUNTED = ("part", "mounting", "mounted_on")
"""Facts of a gear card that say that it is the same gear, mounted as it was."""
_SECONDS_PER_DAY = 86400.0


def facts_of(folder: Path, serial: str, bench: str) -> dict[str, Any]:
    """What a campaign must find again when it goes on: its bench, and how its gear is mounted."""
    card = card_for(folder, serial)
    mounted = {
        name: from_cards(str(getattr(card.facts, name))) if card else "" for name in _MOUNTED
    }
    return {"bench": bench, "mounted": mounted}


def refuse_another(journal: Journal, plan: CampaignPlan, facts: Mapping[str, Any]) -> None:
    """Raise `ConfigurationError` for a campaign that was begun by another plan or on another bench."""
    for what, begun, now in (
        ("by another plan", journal.begun.get("plan_sha256"), plan.sha256),
        ("on another bench", journal.begun.get("bench"), facts["bench"]),
    ):
        if begun != now:
            raise ConfigurationError(
                f"this campaign was begun {what}",
                where=str(journal.path),
                value=now,
                limit=str(begun),
                remedy="Begin it anew with --anew; its runs stay in the folder.",
            )


def outdated(
    journal: Journal, facts: Mapping[str, Any], folder: Path, now: str
) -> Iterator[tuple[int, str]]:
    """The stages whose run does not count any more, with the reason."""
    begun = journal.begun.get("mounted", {})
    moved = [name for name in _MOUNTED if from_cards(begun.get(name, "")) != facts["mounted"][name]]
    for index in range(len(journal.begun.get("protocols", ()))):
        done = journal.newest(index)
        if done is None or not done.counts:
            continue
        reason = _file_of(folder / done.run)
        if not reason and moved and catalogue.load(done.protocol).gear_mounted:
            reason = f"the gear's card says another {moved[0].replace('_', ' ')} since"
        if not reason and done.protocol == tare_kind():
            reason = _tare(done, folder, now, str(facts["bench"]))
        if reason:
            yield index, reason


def _file_of(path: Path) -> str:
    """Why a run file is not what was recorded; "" for one that is."""
    try:
        seal = check_seal(path)
    except (RigError, OSError) as error:
        return f"its file cannot be used: {error}"
    return "" if seal.is_whole else "its file is not sealed"


def _tare(done: DoneStage, folder: Path, now: str, bench: str) -> str:
    """Why a tare is too old for what follows; "" for one that is not."""
    days, allowed = _days(done.at, now), tare_days_of(folder)
    if days > allowed:
        return f"it is {days:.1f} days old, limit {allowed:g}"
    for run in LibraryIndex(folder).search():
        if run.outcome == "TRIPPED" and run.bench == bench and _days(done.at, run.start) > 0.0:
            return f"the bench tripped since ({run.run_id})"
    return ""


def _days(before: str, after: str) -> float:
    try:
        first, last = datetime.fromisoformat(before), datetime.fromisoformat(after)
        return (last - first).total_seconds() / _SECONDS_PER_DAY
    except (ValueError, TypeError):
        return 0.0
