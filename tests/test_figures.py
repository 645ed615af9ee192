"""The figures of the papers, drawn by `renders/figures.py`."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

RENDERS = Path(__file__).parents[1] / "renders"
METALS = pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="optical constants are not installed")


@pytest.fixture(scope="module")
def figures() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(RENDERS)
        yield importlib.import_module("figures")


@METALS
def test_the_page_that_ships_says_what_the_curves_measure(
    figures: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "HERE", tmp_path)
    figures.main([])
    assert (tmp_path / "README.md").read_text() == (RENDERS / "figures" / "README.md").read_text()
    drawn = {path.name for path in tmp_path.glob("*.png")}
    assert drawn == {path.name for path in (RENDERS / "figures").glob("*.png")}
    assert all((tmp_path / name).stat().st_size > 10_000 for name in drawn)


def test_one_figure_alone_leaves_the_page_as_it_is(
    figures: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "HERE", tmp_path)
    figures.main(["oren-nayar-10"])
    assert [path.name for path in tmp_path.iterdir()] == ["oren-nayar-10.png"]
