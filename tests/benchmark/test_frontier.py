"""The suite that compares errors at equal times, on captures of 32×32 pixels."""

from __future__ import annotations

import pytest
import torch
from rich.console import Console

from matest.benchmark import Effort, load
from matest.benchmark.instruments import curves
from matest.benchmark.instruments.contest import GLOSSY
from matest.benchmark.rivals import race, renderers
from matest.benchmark.suite import Record
from matest.benchmark.suites import frontier

SIZE = 32
CASE = "oren-nayar vase"
CASES = frontier.CASES


@pytest.fixture(autouse=True)
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def records() -> list[Record]:
    """Of the rough vase, and of the renderers where they are missing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(frontier, "SIZE_QUICK", SIZE)
        patch.setattr(frontier, "PATIENCE_QUICK", 0.2)
        patch.setattr(race, "BATCH", 2000)
        patch.setattr(frontier, "CASES", {CASE: CASES[CASE]})
        found = list(load("frontier").run(Effort(quick=True)))
        patch.setattr(frontier, "CASES", {GLOSSY: CASES["cook-torrance sphere"]})
        patch.setattr(renderers, "race_of_sphere", lambda *_: {"mitsuba": [], "dr.jit": []})
        found += load("frontier").run(Effort(quick=True, against=("mitsuba",)))
    return found


def test_every_estimator_has_its_curve_and_its_times(records: list[Record]) -> None:
    found = {(record.case, record.metric): record.value for record in records}
    assert len(found) == len(records)
    assert found[CASE, "matest: to 2 bounds"] > 0
    assert found[CASE, "matest: error at the end"] < 2
    for peer in ("levenberg-marquardt", "least_squares", "l-bfgs"):
        # All have the same likelihood, and so the same optimum.
        same = pytest.approx(found[CASE, "matest: error at the end"], rel=0.05)
        assert found[CASE, f"{peer}: error at the end"] == same
        taken = found[CASE, f"{peer}: to 1 %"]
        assert found[CASE, f"{peer}: to 1 % / matest"] == pytest.approx(taken / found[CASE, "matest: to 1 %"])
        assert found[CASE, f"{peer}: point 0, seconds"] > 0
    assert found[CASE, "adam: error at the end"] > 0
    assert found[GLOSSY, "mitsuba: error at the end"] is None


def test_table_fits_and_says_what_is_missing_and_where_matest_loses(records: list[Record]) -> None:
    slower = [r for r in records if r.metric == "l-bfgs: to 1 % / matest"]
    records = [r for r in records if r not in slower]
    records += [Record("frontier", r.case, r.metric, 0.5, "1", "higher", 1.0) for r in slower]
    terminal = Console(width=80, record=True)
    terminal.print(load("frontier").table(records))
    shown = terminal.export_text()
    assert "…" not in shown
    assert "oren-nayar vase, l-bfgs, to 1 %: in 0.5 of matest's time" in shown
    assert "mitsuba: not measured: Mitsuba 3 or LLVM is missing" in shown.replace("\n", " ")


def test_copper_is_compared_whichever_lobe_comes_first() -> None:
    case = frontier.CASES["copper vase"](SIZE)
    yardstick = curves.Yardstick(case.truth, case.bound(), case.truth)
    swapped = {
        **case.truth,
        "slope": case.truth["slope_2"],
        "slope_2": case.truth["slope"],
        "weight_2": 1 - case.truth["weight_2"].double(),
    }
    assert yardstick.step(0.0, swapped).error == pytest.approx(0.0, abs=1e-9)
    assert set(yardstick.bound) == {"f0", "slope", "slope_2", "weight_2"}


def test_bounds_of_paper_are_of_what_light_from_the_viewer_s_side_shows() -> None:
    case = frontier.CASES["laser-paper sphere"](SIZE)
    bound = case.bound()
    assert set(bound) == {"k_uds", "k_dd", "correlation_length"} == set(case.task.free)
    assert all(bool((std < 0.1 * case.truth[name]).all()) for name, std in bound.items())


@pytest.mark.parametrize("name", list(frontier.CASES))
def test_no_pixel_that_peers_get_is_clipped(name: str) -> None:
    photographs = frontier.CASES[name](SIZE).capture.photographs
    saturated = photographs.encoding.saturated
    assert all(image.min() > 0 and not saturated(image).any() for image in photographs.stored)
