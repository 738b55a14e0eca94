"""What version 0.1.0 wrote is still read, and what it stored keeps the numbers that it gave (tests/data/0.1.0)."""

from __future__ import annotations

import copy
import json
import math
import re
import shutil
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from experiments import catalogue
from rig.analysis.store import NOT_SEALED_THEN
from rig.main import run
from rig.run.latch import LatchedTripError, TripLatch
from rig.runfile.read import close_recording, open_run

WRITTEN = Path(__file__).parents[1] / "data" / "0.1.0"
EXPECTED: dict[str, Any] = json.loads((WRITTEN / "expected.json").read_text(encoding="utf-8"))
BY_DESIGN: dict[str, dict[str, Any]] = json.loads(
    (WRITTEN / "changed_by_design.json").read_text(encoding="utf-8")
)
"""What is answered otherwise since on purpose: the reason, then place by place what is answered now."""
OF_THE_MOMENT = frozenset({"index", "at", "program_version", "git_commit", "analysed"})
"""Keys whose values say when, where and by which version the command was run, not what it found."""
SAID_SINCE = {"run, with U (k = 2)": "run, with U (95 %)"}
"""Words for the same thing that were others then."""
PLACE = re.compile(r"([^.\[\]]+)|\[(\d+)\]")
"""The steps of a place: keys, and numbers in brackets."""
ASKED_SINCE = {"import": ("--output-sense", "-1")}
"""What a command has to say since that was guessed then: which way the output angle counts."""
WRITTEN_NOW = {"show_recovered", "verify_recovered", "show_anew", "verify_anew"}
"""Commands on files that this version has just written: the hash of such a file is its own."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy that may be written to."""
    written = tmp_path_factory.mktemp("version") / "0.1.0"
    shutil.copytree(WRITTEN, written)
    return written


def differences(expected: Any, answer: Any, where: str = "") -> list[str]:
    """Where an answer does not hold what is expected; keys that are new are no difference."""
    if isinstance(expected, dict):
        if not isinstance(answer, dict):
            return [f"{where}: no object"]
        lines = [f"{where}.{key}: is gone" for key in expected if key not in answer]
        for key in expected.keys() & answer.keys() - OF_THE_MOMENT:
            lines += differences(expected[key], answer[key], f"{where}.{key}")
        return lines
    if isinstance(expected, list):
        if not isinstance(answer, list) or len(answer) != len(expected):
            return [f"{where}: another length"]
        return [
            line
            for i, (one, other) in enumerate(zip(expected, answer, strict=True))
            for line in differences(one, other, f"{where}[{i}]")
        ]
    if isinstance(expected, float) and isinstance(answer, float):
        # Another processor may round the last digits of a fit differently.
        same = math.isclose(expected, answer, rel_tol=1e-6, abs_tol=1e-12)
        return [] if same else [f"{where}: {answer!r} instead of {expected!r}"]
    expected = SAID_SINCE.get(expected, expected) if isinstance(expected, str) else expected
    return [] if expected == answer else [f"{where}: {answer!r} instead of {expected!r}"]


def changed_by_design(name: str, expected: Any) -> Any:
    """What 0.1.0 answered, with what is answered otherwise on purpose in its place; each such place must differ."""
    answers = {name: copy.deepcopy(expected)}
    for where, now in [place for places in BY_DESIGN.values() for place in places.items()]:
        steps: list[Any] = [int(i) if i else key for key, i in PLACE.findall(where)]
        if steps[0] != name:
            continue
        holder: Any = answers
        for step in steps[:-1]:
            holder = holder[step]
        assert holder[steps[-1]] != now, f"{where} is what it was: take it out of the list"
        holder[steps[-1]] = now
    return answers[name]


def without_the_end(answer: Any) -> Any:
    """A difference without the time at which a run ended, which is compared since as a line of its own."""
    lines = [line for line in answer["changes"] if (line["group"], line["name"]) == ("run", "end")]
    assert len(lines) == 1
    answer["changes"].remove(lines[0])
    answer["compared"]["run"] -= 1
    return answer


def without_control_limits(expected: Any) -> Any:
    """A passport of 0.1.0 without the rules of its control charts, in whose place alarms with a promise have come."""
    del expected["rules"]
    for series in expected["series"]:
        assert series.pop("state") == "no control limits yet"
        del series["control_limits"], series["notes"]
        for point in series["points"]:
            del point["signals"], point["within_uncertainty"]
    return expected


def without_stale(answer: Any) -> Any:
    """A passport without what it says of analyses that are stale or not sealed, as every one of 0.1.0 is."""
    unsealed = [line for line in answer["missing"] if NOT_SEALED_THEN in line["what"]]
    assert [line["run"] for line in unsealed] == ["00003-friction-SN_010", "00004-friction-SN_010"]
    version = catalogue.load("friction").version
    stale = [line for line in answer["missing"] if "is stale" in line["what"]]
    assert [(line["run"], line["what"]) for line in stale] == [
        (run_id, f"its friction analysis 1 is stale: {reason}")
        for run_id in ("00003-friction-SN_010", "00004-friction-SN_010")
        for reason in (
            "the parameter set of the gear is another one now",
            "it was made before analyses were checked for evidence",
            f"it was made by version 1 of the friction analysis, which is at {version}",
        )
    ]
    # Stiffness over inertia was not followed then.
    since = [line for line in answer["missing"] if line["what"].startswith("Secant stiffness")]
    assert [line["remedy"] for line in since] == ["rig run velocity-steps"]
    besides = (*stale, *unsealed, *since)
    answer["missing"] = [line for line in answer["missing"] if line not in besides]
    return answer


def without_hashes(answer: Any) -> Any:
    """Show and verify of a file that has been written just now, without its SHA-256."""
    answer.pop("sha256", None)
    for entry in answer.get("runs", ()):
        entry["findings"] = [f for f in entry["findings"] if f["check"] != "hash"]
    return answer


def without_new_checks(expected: Any, answer: Any) -> Any:
    """What verify found by the checks that there were then; every later one must be content."""
    for then, now in zip(expected["runs"], answer["runs"], strict=True):
        checks = {finding["check"] for finding in then["findings"]}
        new = [finding for finding in now["findings"] if finding["check"] not in checks]
        assert {finding["level"] for finding in new} <= {"ok"}, new
        now["findings"] = [finding for finding in now["findings"] if finding["check"] in checks]
    return answer


def without_numbers(fit: dict[str, Any]) -> dict[str, Any]:
    """What a fit is about: a later version of its analysis finds numbers of its own."""
    units = {name: estimate["unit"] for name, estimate in fit["parameters"].items()}
    return {"run": fit["run"], "kind": fit["kind"], "units": units}


@pytest.fixture(scope="module")
def answers(folder: Path) -> dict[str, tuple[int, str, str]]:
    """What every command answers in the copy, called in the order in which 0.1.0 was: exit code, output, errors."""
    results = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name, entry in EXPECTED.items():
            output, errors = StringIO(), StringIO()
            with redirect_stdout(output), redirect_stderr(errors), pytest.raises(SystemExit) as end:
                run([*entry["arguments"], *ASKED_SINCE.get(name, ()), "--json"])
            results[name] = (int(str(end.value.code or 0)), output.getvalue(), errors.getvalue())
    return results


@pytest.mark.parametrize("name", EXPECTED)
def test_every_command_answers_as_0_1_0_did(
    name: str, answers: dict[str, tuple[int, str, str]]
) -> None:
    entry, (code, output, errors) = EXPECTED[name], answers[name]
    assert code == entry["exit"], errors
    expected = changed_by_design(name, entry["answer"])
    if expected is None:
        assert not output
        return
    answer = json.loads(output)
    if name == "passport":
        expected, answer = without_control_limits(expected), without_stale(answer)
    if entry["arguments"][0] == "diff":
        answer = without_the_end(answer)
    if name in WRITTEN_NOW:
        expected, answer = without_hashes(expected), without_hashes(answer)
    if entry["arguments"][0] == "verify":
        answer = without_new_checks(expected, answer)
    if entry["arguments"][0] == "fit" and catalogue.load(expected["kind"]).version > 1:
        expected, answer = without_numbers(expected), without_numbers(answer)
    assert not differences(expected, answer, name)


def test_the_comparison_would_notice_a_number_and_a_key_that_is_gone() -> None:
    assert differences({"a": [1.0, {"b": 2}]}, {"a": [1.0 + 1e-5, {}], "c": 0}) == [
        ".a[0]: 1.00001 instead of 1.0",
        ".a[1].b: is gone",
    ]


def test_the_list_of_what_changed_names_commands_and_each_place_once() -> None:
    places = [where for changed in BY_DESIGN.values() for where in changed]
    assert len(places) == len(set(places))
    assert {PLACE.findall(where)[0][0] for where in places} <= EXPECTED.keys()
    with pytest.raises(AssertionError, match="take it out"):
        changed_by_design("show_home", {"outcome": "COMPLETED"})


def test_every_run_of_the_folder_is_marked_as_what_it_is() -> None:
    for path in sorted(WRITTEN.rglob("*.h5")):
        recording = open_run(path, verify=True)
        expected = "imported" if "import" in path.name else "simulated"
        assert recording.metadata.origin == expected, path.name
        close_recording(recording)


def test_the_latch_of_0_1_0_still_refuses() -> None:
    with pytest.raises(LatchedTripError, match="over_temperature in run 00001-friction-SN_010"):
        TripLatch(WRITTEN / "tripped").refuse()
