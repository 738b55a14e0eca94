"""Every command of a how-to is run as it stands; those that need an extra are run by `tests/extras`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.page_commands import PAGES, WITH_EXTRAS, hold_page, with_commands


@pytest.mark.parametrize(
    "page",
    with_commands(p for p in PAGES if p.parent.name == "howto" and p.stem not in WITH_EXTRAS),
)
def test_every_command_of_a_page_works(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    hold_page(page, tmp_path, monkeypatch, capsys)
