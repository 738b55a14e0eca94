"""The stages as a whole: in their order, recorded one by one, going on where they stopped."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from drivers.bus.listening import ListeningBus
from experiments.steps.note import Prompt
from rig.bench.backends.assembly import AssembledRig
from rig.bench.backends.order import Order, Setup
from rig.bench.commissioning import JOURNAL_NAME, NAMES, STAGES, read_record
from rig.bench.identity import bench_of
from rig.errors import ConfigurationError
from rig.main import app
from rig.run.start import bench_for
from rig.run.stop import StopRequest
from rig.runfile.seal import file_sha256
from rig.trial.commission.conduct import BEGUN, do_stage, missing_of, stages_to_do
from rig.trial.commission.work import Seen, Work
from tests.rig.commands.printed import every_table_has_room
from tests.rig.trial.commission.benches import Described, described

STAGE = {stage.name: stage for stage in STAGES}


def commission(*words: str) -> tuple[int, Any]:
    answer = CliRunner().invoke(app, ["commission", "--backend", "wire", "--json", *words])
    return answer.exit_code, json.loads(answer.stdout) if answer.stdout else answer.stderr


def test_a_simulated_bench_is_taken_through_every_stage(tmp_path: Path) -> None:
    where = ("--runs", str(tmp_path), "--operator", "A. Example", "--sample-rate", "50")
    code, found = commission(*where)
    assert (code, found["ok"], found["missing"]) == (0, True, [])
    assert tuple(found["stages"]) == NAMES
    record = read_record(tmp_path)
    runs = {name: sha256 for done in record for name, sha256 in done.runs.items()}
    # Seven that turn, each with its frames, and the frames of the three that do not.
    assert len(runs) == 17
    assert all(file_sha256(tmp_path / name) == sha256 for name, sha256 in runs.items())
    assert {done.operator for done in record} == {"A. Example"}
    sealed = json.loads(Path(found["record"]).read_bytes())
    assert (sealed["bench"], sealed["complete"]) == (bench_of("wire", tmp_path).id, True)
    assert [one["stage"] for one in sealed["stages"]] == list(NAMES)
    assert sealed["devices"]["node 1"]["vendor_id"]
    assert sealed["journal_sha256"] == file_sha256(tmp_path / JOURNAL_NAME)
    verified = CliRunner().invoke(app, ["verify", found["record"]])
    assert verified.exit_code == 0, verified.stdout
    (tmp_path / next(iter(runs))).write_bytes(b"another")
    verified = CliRunner().invoke(app, ["verify", found["record"]])
    assert verified.exit_code == 6
    _, listed = commission("--runs", str(tmp_path), "--list")
    assert [one["stage"] for one in listed["stages"]] == list(NAMES)
    assert not any(one["missing"] for one in listed["stages"])
    with every_table_has_room():
        words = ["commission", "--backend", "wire", "--runs", str(tmp_path), "--list"]
        assert CliRunner().invoke(app, words).exit_code == 0


def work_of(bench: Described, ask: Callable[[Prompt], str | None], make: object = None) -> Work:
    order = bench.order
    return Work(
        order=order,
        bench=bench_for(order),
        ask=ask,
        stop=StopRequest(),
        now=lambda: "2026-11-27T08:00:00+00:00",
        make=make or bench.make,  # type: ignore[arg-type]
    )


def by_a_person(bench: Described) -> Callable[[Order, Setup], AssembledRig]:
    """The bench without somebody who acts by himself: the questions are asked."""
    return lambda order, setup: replace(bench.make(order, setup), person=None)


def answering(**answers: str) -> Callable[[Prompt], str | None]:
    return lambda prompt: prompt.consent or answers.get(prompt.key.replace("-", "_"), "")


class KilledError(BaseException):
    """The process is gone."""


@pytest.fixture
def killed(monkeypatch: pytest.MonkeyPatch) -> Callable[[Described], None]:
    """Does the stage up to where the process is gone."""

    def dies(*words: object) -> None:
        raise KilledError

    def begin(bench: Described) -> None:
        work = work_of(bench, answering(), by_a_person(bench))
        with monkeypatch.context() as program:
            program.setattr(Work, "turn", dies)
            with pytest.raises(KilledError):
                do_stage(STAGE["stop-kill"], work, "D")

    return begin


@pytest.mark.parametrize(("seconds", "fine"), [("0.4", True), ("4", False), ("", False)])
def test_a_stage_that_kills_the_program_is_looked_at_when_it_is_started_again(
    seconds: str, fine: bool, tmp_path: Path, killed: Callable[[Described], None]
) -> None:
    bench = described(tmp_path)
    killed(bench)
    (begun,) = read_record(tmp_path)
    assert (begun.passed, BEGUN in begun.answers) == (False, True)
    work = work_of(bench, answering(seconds=seconds), by_a_person(bench))
    seen = do_stage(STAGE["stop-kill"], work, "D")
    assert [finding.what for finding in seen.findings] == ["standstill", "drive"]
    assert seen.is_fine is fine
    left = {one.stage for one in missing_of(work.bench, "D")}
    assert ("stop-kill" not in left) is fine


def test_a_stage_that_was_too_slow_is_done_again_from_its_beginning(
    tmp_path: Path, killed: Callable[[Described], None]
) -> None:
    bench = described(tmp_path)
    killed(bench)
    do_stage(STAGE["stop-kill"], work_of(bench, answering(seconds="4"), by_a_person(bench)), "D")
    killed(bench)
    assert [BEGUN in done.answers for done in read_record(tmp_path)] == [True, False, True]


def test_a_motor_that_nobody_kills_is_no_proof(tmp_path: Path) -> None:
    bench = described(tmp_path)
    seen = do_stage(STAGE["stop-kill"], work_of(bench, answering(), by_a_person(bench)), "D")
    assert not seen.is_fine
    assert "not done" in seen.findings[-1].remedy
    assert "stop-kill" in {one.stage for one in missing_of(bench_for(bench.order), "D")}


def test_a_stop_at_a_question_ends_the_stage(tmp_path: Path) -> None:
    bench = described(tmp_path)
    stop = StopRequest()

    def ask(prompt: Prompt) -> None:
        stop.press()

    work = replace(work_of(bench, ask, by_a_person(bench)), stop=stop)
    seen = do_stage(STAGE["uncoupled"], work, "D")
    assert not seen.is_fine
    assert not seen.runs
    assert bench.moved == 0.0


def test_the_hand_is_counted_while_it_turns_and_nothing_is_commanded(tmp_path: Path) -> None:
    bench, sent = described(tmp_path), []
    made: list[AssembledRig] = []

    def make(order: Order, setup: Setup) -> AssembledRig:
        rig = bench.make(order, setup)
        made.append(rig)

        def quiet() -> ListeningBus:
            assert rig.quiet_bus is not None
            bus = rig.quiet_bus()
            send = bus.send

            def noted(cob_id: int, data: bytes) -> None:
                sent.append((cob_id, data[0] >> 5))
                send(cob_id, data)

            bus.send = noted  # type: ignore[method-assign]
            return bus

        return replace(rig, person=None, quiet_bus=quiet)

    asked: Iterator[int] = iter(range(10_000))

    def ask(prompt: Prompt) -> str | None:
        person = made[-1].person
        assert person is not None
        if prompt.key == "turn-shaft" and next(asked) == 0:
            person("turn-shaft")
            return None
        return (person(prompt.key) or prompt.consent) if prompt.consent else "10"

    seen = do_stage(STAGE["hand"], work_of(bench, ask, make), "D")
    assert seen.is_fine, [finding.sentence for finding in seen.findings]
    # SDO uploads alone: client command specifier 2 (initiate upload), to the nodes' own COB-IDs.
    assert {(cob_id & 0x780, specifier) for cob_id, specifier in sent} == {(0x600, 2)}


@pytest.mark.parametrize(
    ("said", "words"), [("3", "turns by hand"), ("20", "input encoder"), ("", "turns by hand")]
)
def test_a_hand_that_turned_otherwise_than_was_said(said: str, words: str, tmp_path: Path) -> None:
    bench = described(tmp_path)

    def make(order: Order, setup: Setup) -> AssembledRig:
        rig = bench.make(order, setup)
        act = rig.person
        assert act is not None
        return replace(
            rig, person=lambda key: (act(key), said)[1] if key == "turn-shaft" else act(key)
        )

    seen = do_stage(STAGE["hand"], work_of(bench, answering(), make), "D")
    assert words in [finding.what for finding in seen.findings if finding.severity == "blocks"]


def test_a_stage_waits_for_those_before_it(tmp_path: Path) -> None:
    missing = missing_of(bench_for(described(tmp_path).order), "D")
    with pytest.raises(ConfigurationError, match="stages before it are missing"):
        stages_to_do(missing, ["coupled"])
    with pytest.raises(ConfigurationError, match="no such stage"):
        stages_to_do(missing, ["couple"])
    assert [stage.name for stage in stages_to_do(missing, ())] == list(NAMES)
    assert [stage.name for stage in stages_to_do(missing[1:], ["read", "listen"])] == [
        "listen",
        "read",
    ]


def test_another_master_is_heard_before_anything_is_sent(tmp_path: Path) -> None:
    bench = described(tmp_path)

    def make(order: Order, setup: Setup) -> AssembledRig:
        rig = bench.make(order, setup)
        assert rig.quiet_bus is not None
        bus = rig.quiet_bus()

        def noisy() -> ListeningBus:
            listen = bus.listen

            def heard(duration_ns: int) -> None:
                listen(duration_ns)
                bus.heard[0x601, False] += 3

            bus.listen = heard  # type: ignore[method-assign]
            return bus

        return replace(rig, quiet_bus=noisy)

    seen = do_stage(STAGE["listen"], work_of(bench, answering(), make), "D")
    assert not seen.is_fine
    assert "SDO requests to node 1" in seen.findings[0].found


def test_what_is_seen_of_nothing_is_no_failure() -> None:
    assert Seen().is_fine
