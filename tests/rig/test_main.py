"""The command line as a whole: light, complete, and with endings that mean something."""

import json
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from drivers.errors import BusLostError, DriverError
from experiments import catalogue
from experiments.errors import AnalysisError, PlanError
from model.errors import ModelError, ParameterError
from rig import exits, main
from rig.errors import LimitError, RigError, RunFileError
from rig.trial.drill.rigs import CARRIERS
from tests.rig.test_one_verdict import judged, random_store

HEAVY = ("numpy", "scipy", "h5py", "numba", "matplotlib", "pydantic")


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=1800, check=False
    )


def loaded_by(arguments: list[str], modules: tuple[str, ...]) -> list[str]:
    """Those of the modules that a command loads."""
    code = (
        "import sys, json\nfrom rig.main import run\n"
        f"try:\n    run({arguments!r})\nexcept SystemExit as end:\n    code = end.code\n"
        f"print(); print(json.dumps([code, [m for m in {modules!r} if m in sys.modules]]))"
    )
    done = run_python(code)
    exit_code, loaded = json.loads(done.stdout.strip().splitlines()[-1])
    assert exit_code == 0, done.stderr
    return loaded


def test_help_loads_nothing_heavy() -> None:
    assert loaded_by(["--help"], HEAVY) == []


def test_a_list_of_runs_loads_no_bus(tmp_path: Path) -> None:
    assert loaded_by(["runs", str(tmp_path)], ("can", "asyncio", "scipy", "numba")) == []


def test_a_command_is_built_without_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """To read the options of all takes longer than many a command."""
    asked: list[str] = []
    built = main._built

    def told(name: str, *more: Any) -> Any:
        asked.append(name)
        return built(name, *more)

    monkeypatch.setattr(main, "_built", told)
    assert CliRunner().invoke(main.app, ["runs", "--help"]).exit_code == 0
    assert asked == ["runs"]


def test_a_list_of_judged_runs_imports_no_kernels(tmp_path: Path) -> None:
    """The titles of the limits are read from what the protocol declares; stored numbers keep the k they have."""
    run = random_store(tmp_path, random.Random(0))
    assert judged(run).verdict in ("PASS", "MARGINAL", "FAIL")
    assert loaded_by(["runs", str(tmp_path)], ("scipy", "numba")) == []


def test_protocols_and_their_flags_are_listed_without_kernels() -> None:
    for words in (["plan", "--help"], ["plan", "friction", "--help"]):
        assert loaded_by(words, ("scipy", "numba")) == [], words


def test_help_names_every_command() -> None:
    done = run_python("from rig.main import run; run(['help'])")
    for command in (
        "plan",
        "run",
        "demo",
        "fit",
        "validate",
        "report",
        "model",
        "runs",
        "show",
        "import",
        "export",
        "recover",
        "verify",
    ):
        assert f" {command} " in done.stdout


def test_the_first_page_has_the_commands_of_a_day_a_line_each() -> None:
    runner = CliRunner()
    page = runner.invoke(main.app, ["--help"]).output
    told = [line for line in page.splitlines() if line.startswith("  ") and line[2] != "M"]
    day = "demo live config doctor gear plan run campaign fit report certificate import"
    assert " ".join(line.split()[0] for line in told) == day
    assert all(len(line) <= 80 and line.endswith(".") and len(line.split()) > 3 for line in told)
    assert len(page.splitlines()) <= 24
    assert "More: rig help" in page
    alone = run_python("from rig.main import run; run([])")
    assert alone.stdout.splitlines()[1:] == page.splitlines()[1:]
    one = runner.invoke(main.app, ["help", "gear", "new"])
    assert one.exit_code == 0
    assert one.output.strip() == runner.invoke(main.app, ["gear", "new", "--help"]).output.strip()
    wrong = runner.invoke(main.app, ["help", "gaer"])
    assert (wrong.exit_code, "Did you mean gear" in wrong.output) == (exits.USAGE, True)


def test_every_command_has_help_worth_reading() -> None:
    code = (
        "import typer\nfrom rig.main import PANELS\n"
        "for commands in PANELS.values():\n"
        "    for command in commands:\n"
        "        assert command.__doc__ and len(command.__doc__.strip()) > 40, command\n"
        "print('fine')"
    )
    assert run_python(code).stdout.strip() == "fine"


def test_help_names_every_kind_of_fit_and_every_carrier_of_a_drill() -> None:
    """What a text lists that a table lists as well."""

    def help_of(*command: str) -> str:
        shown = CliRunner().invoke(main.app, [*command, "--help"]).output
        return " ".join(shown.replace("│", " ").split())

    named = help_of("fit")
    assert [kind for kind in catalogue.kinds() if kind not in named] == []
    named = help_of("sim", "drill")
    assert [carrier for carrier in CARRIERS if carrier not in named] == []


def test_help_is_broken_into_lines_by_the_terminal_alone() -> None:
    from rig.commands.earlier_names import flowing

    for words in ("fit",), ("bench", "show"), ("fleet", "rr"):
        page = CliRunner().invoke(main.app, ["help", *words], env={"COLUMNS": "400"}).output
        told = [line for line in page.partition("╭")[0].splitlines() if line.strip()]
        assert all(line.rstrip().endswith((".", ":", "...", "]")) for line in told), told
    assert flowing("One\n  two.\n\nThree:\n- four\n  five\n- six") == (
        "One two.\n\nThree:\n- four five\n- six"
    )


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ParameterError("x"), exits.USAGE),
        (PlanError("x"), exits.USAGE),
        (LimitError("x"), exits.USAGE),
        (ModelError("x"), exits.ERROR),
        (AnalysisError("x"), exits.ERROR),
        (BusLostError("x"), exits.ERROR),
        (DriverError("x"), exits.ERROR),
        (RunFileError("x"), exits.ERROR),
        (RigError("x"), exits.ERROR),
        (KeyboardInterrupt(), exits.ABORTED),
        (FileNotFoundError("x"), exits.ERROR),
    ],
)
def test_every_expected_error_has_a_code_and_a_sentence(error: BaseException, code: int) -> None:
    found = exits.explain(error)
    assert found is not None
    assert found[0] == code
    assert found[1]


def test_a_defect_is_not_explained_away() -> None:
    assert exits.explain(ZeroDivisionError()) is None


@pytest.mark.parametrize(
    ("outcome", "code"),
    [
        ("COMPLETED", 0),
        ("ABORTED", 4),
        ("TRIPPED", 5),
        ("ERROR", 6),
        ("INTERRUPTED", 6),
    ],
)
def test_outcomes_have_the_documented_codes(outcome: str, code: int) -> None:
    assert exits.code_of_outcome(outcome) == code


@pytest.mark.parametrize(
    ("outcome", "verdict", "required", "code"),
    [
        ("COMPLETED", "PASS", False, 0),
        ("COMPLETED", "NOT JUDGED", False, 0),
        ("COMPLETED", "FAIL", False, 1),
        ("COMPLETED", "MARGINAL", True, 3),
        ("COMPLETED", "NOT JUDGED", True, 7),
        ("ABORTED", "FAIL", True, 4),
        ("TRIPPED", "NOT JUDGED", True, 5),
        ("INTERRUPTED", "PASS", False, 6),
    ],
)
def test_the_outcome_decides_before_the_verdict(
    outcome: str, verdict: str, required: bool, code: int
) -> None:
    assert exits.code_of_run(outcome, verdict, required=required) == code


@pytest.mark.parametrize(
    ("verdicts", "required", "code"),
    [
        ((), False, 0),
        (("PASS", "NOT JUDGED"), False, 0),
        (("PASS", "NOT JUDGED"), True, 7),
        (("MARGINAL", "PASS"), False, 3),
        (("MARGINAL", "NOT JUDGED"), True, 7),
        (("MARGINAL", "NOT JUDGED", "FAIL"), True, 1),
    ],
)
def test_several_verdicts_end_as_the_worst_of_them(
    verdicts: tuple[str, ...], required: bool, code: int
) -> None:
    assert exits.code_of_verdicts(verdicts, required=required) == code


def test_the_readme_tells_the_codes_as_the_program_does() -> None:
    rows = [line for line in (exits.__doc__ or "").splitlines() if line.startswith("|")]
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 11
    assert [row for row in rows if row not in readme] == []


@pytest.mark.parametrize(
    ("arguments", "code", "kind"),
    [
        (["show", "no-such-run.h5", "--json"], exits.ERROR, "RunFileError"),
        (["runs", "--no-such-flag", "--json"], exits.USAGE, "NoSuchOption"),
        (["run", "friction", "--points", "x", "--events"], exits.USAGE, None),
    ],
)
def test_an_error_under_json_is_one_object(
    arguments: list[str], code: int, kind: str | None
) -> None:
    done = run_python(f"from rig.main import run; run({arguments!r})")
    assert done.returncode == code
    (line,) = done.stdout.strip().splitlines()
    error = json.loads(line)["error"]
    assert set(error) == {"kind", "where", "value", "limit", "remedy", "message"}
    assert kind is None or error["kind"] == kind
    assert error["message"]
    assert done.stderr


def test_unknown_command_is_a_usage_error() -> None:
    done = run_python("from rig.main import run; run(['does-not-exist'])")
    assert done.returncode == exits.USAGE
    assert "Traceback" not in done.stderr
