"""The peers solve the same problem: they reach the optimum that matest reaches."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from rich.console import Console

from matest.benchmark import Effort, load
from matest.benchmark.instruments.contest import sphere_of
from matest.benchmark.instruments.passes import no_compiler
from matest.benchmark.instruments.photographs import material_of
from matest.benchmark.instruments.task import Task, Trace, distance
from matest.benchmark.rivals import hand_written, race, renderers, solvers
from matest.benchmark.suites import peers
from matest.shading import shade

SIZE = 24
MODELS = tuple(hand_written.MODELS)


@pytest.fixture(autouse=True)
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def task_of(expression: str) -> Task:
    return sphere_of(expression, SIZE).task


@pytest.mark.parametrize("expression", MODELS)
def test_hand_written_radiance_is_the_shader_s(expression: str) -> None:
    task = task_of(expression).double()
    written = hand_written.MODELS[expression](task.points)
    material = material_of(expression)
    truth = material.parameters
    amplitudes = torch.stack([truth[name] for name in written.unknowns.amplitudes])
    radiance, _ = written.evaluate(amplitudes, truth[written.unknowns.shape])
    torch.testing.assert_close(radiance, shade(material, task.points), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("expression", MODELS)
def test_hand_written_jacobian_is_that_of_differences(expression: str) -> None:
    written = hand_written.MODELS[expression](task_of(expression).double().points)
    count = len(written.unknowns.amplitudes)
    amplitudes = torch.tensor([[0.6, 0.4, 0.2], [0.5, 0.7, 0.9]], dtype=torch.float64)[:count]
    shape, step = torch.tensor(0.3, dtype=torch.float64), 1e-6
    _, jacobian = written.evaluate(amplitudes, shape)
    for row in range(len(amplitudes) + 1):
        change = torch.zeros_like(amplitudes)
        bend = torch.zeros_like(shape)
        if row < len(amplitudes):
            change[row] = step
        else:
            bend = bend + step
        above, below = (written.evaluate(amplitudes + s * change, shape + s * bend)[0] for s in (1, -1))
        expected = (above - below) / (2 * step)
        torch.testing.assert_close(jacobian[row].expand_as(expected), expected, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("expression", MODELS)
def test_every_peer_reaches_the_optimum_from_the_middle_of_the_domain(expression: str) -> None:
    task = task_of(expression)
    optimum = hand_written.optimum(task, sphere_of(expression, SIZE).truth)
    assert distance(task.start.parameters, optimum) > 0.1
    for trace in (
        solvers.lbfgs(task),
        solvers.least_squares(task),
        hand_written.levenberg_marquardt(task),
        solvers.adam(task, None, 0.1, lambda trace: trace.settled(optimum, 30)),
        solvers.adam(task, 2000, 0.03, lambda trace: trace.settled(optimum, 30)),
    ):
        assert distance(trace.values[-1], optimum) < 0.01
        assert trace.arrival(optimum) is not None


@pytest.mark.parametrize("solve", [solvers.lbfgs, solvers.least_squares])
def test_a_solver_that_is_out_of_time_hands_over_what_it_has(solve: Callable[..., Trace]) -> None:
    task = task_of("oren-nayar")
    whole, cut = solve(task), solve(task, patience=0.0)
    assert len(cut.values) < len(whole.values)
    assert distance(cut.values[-1], cut.values[-2]) == 0
    assert cut.seconds[-1] >= cut.seconds[-2]


@pytest.mark.skipif(bool(no_compiler()), reason=no_compiler())
def test_compiled_solvers_do_the_same_as_eager_ones() -> None:
    task = task_of("oren-nayar")
    steps = [
        solvers.adam(task, None, 0.1, lambda trace: len(trace.values) == 5, compiled=compiled).values[-1]
        for compiled in (False, True)
    ]
    assert distance(*steps) < 1e-4
    optimum = hand_written.optimum(task, sphere_of("oren-nayar", SIZE).truth)
    assert distance(solvers.lbfgs(task, compiled=True).values[-1], optimum) < 0.01


def test_every_figure_is_there_and_matest_is_at_the_optimum(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "QUICK", peers.Size(SIZE, race.Rules((0.1,), 1, 120.0), 0.3, MODELS, judged=False))
    monkeypatch.setattr(race, "BATCH", 2000)
    monkeypatch.setattr(peers, "ROUNDS", 1)
    monkeypatch.setattr(renderers, "race", lambda *_: {"mitsuba": [], "dr.jit": []})
    found = list(load("peers").run(Effort(quick=True)))
    by_metric = {(record.case, record.metric): record for record in found}
    assert len(by_metric) == len(found)
    for case in MODELS:
        assert by_metric[case, "distance"].value < 0.01
        for peer in ("adam", "adam, mini-batches", "l-bfgs", "least_squares", "levenberg-marquardt"):
            ratio, seconds = by_metric[case, f"{peer} / matest"], by_metric[case, peer]
            # A quick run is too small for limits.
            assert (ratio.limit, ratio.better) == (None, "higher")
            if seconds.value is None:
                assert ratio.value > 0
                assert "at least: never within 1%" in ratio.note
            else:
                assert ratio.value == pytest.approx(seconds.value / by_metric[case, "matest"].value)
    terminal = Console(width=80, record=True)
    terminal.print(load("peers").table(found))
    shown = terminal.export_text()
    assert "…" not in shown
    names = ("least_squares", "l-bfgs", "adam", "mitsuba", "dr.jit", "oren-nayar", "cook-torrance", "masking=smith")
    assert all(name in shown for name in names)
    assert "Mitsuba 3 or LLVM is missing" in shown.replace("\n  ", " ")


def test_arrival_is_when_the_parameters_come_to_stay() -> None:
    optimum = {"sigma": torch.tensor(0.5)}
    trace = Trace(seconds=[1.0, 2.0, 3.0, 4.0], values=[{"sigma": torch.tensor(s)} for s in (0.5, 0.4, 0.502, 0.497)])
    assert trace.arrival(optimum) == 3.0
    assert trace.settled(optimum, 2)
    assert not trace.settled(optimum, 3)
    trace.seconds.append(5.0)
    trace.values.append({"sigma": torch.tensor(math.nan)})
    assert trace.arrival(optimum) is None
