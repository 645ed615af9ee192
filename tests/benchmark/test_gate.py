"""A run that is worse than the baseline fails, and says where."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import matest
from matest import benchmark, cli
from matest.benchmark import baseline, gate
from matest.benchmark.baseline import Baseline, Figure
from matest.benchmark.suite import Record
from matest.benchmark.suites import efficiency, limits, scaling
from tests.benchmark.test_efficiency import Here


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path):
    """`matest benchmark --quick ARGUMENTS` on tiny suites in an empty checkout: exit code, output, errors."""
    monkeypatch.setattr(efficiency, "processes", Here)
    monkeypatch.setattr(efficiency, "MODELS", ("lambert",))
    monkeypatch.setattr(efficiency, "CAPTURES_QUICK", 3)
    monkeypatch.setattr(scaling, "SIDES_QUICK", (16, 20, 24))
    monkeypatch.setattr(scaling, "TIMES", (1, 2, 4))
    monkeypatch.setattr(scaling, "IMAGES", 2)
    monkeypatch.setattr(limits, "machine", lambda: limits.Limits(1e-10, 1e-7, 1e-9, 1e-9))
    monkeypatch.setenv("COLUMNS", "80")
    (tmp_path / "tests").mkdir()
    monkeypatch.chdir(tmp_path)

    def invoke(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["matest", "benchmark", "--quick", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capfd.readouterr()
        return int(ended.value.code or 0), out, err

    return invoke


@pytest.fixture
def written(run, tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    """Write the baseline of a suite from a run of it; gives the file of its records."""

    def write(suite: str) -> Path:
        code, out, _ = run("--suite", suite, "--json")
        assert code == 0
        records = tmp_path / "records.jsonl"
        records.write_text(out, "utf-8")
        baseline.main(str(records))
        capfd.readouterr()
        return records

    return write


def test_an_unchanged_run_passes(run, written) -> None:
    written("efficiency")
    code, out, err = run("--suite", "efficiency", "--gate")
    assert (code, err) == (0, "")
    assert "Gate: none of 5 figures is worse" in out


def test_a_biased_estimator_fails_by_the_names_of_its_figures(run, written, monkeypatch: pytest.MonkeyPatch) -> None:
    written("efficiency")
    estimate = matest.estimate

    def biased(*arguments: Any, **options: Any) -> Any:
        found = estimate(*arguments, **options)
        albedo = found.parameters["albedo"]
        value = [1.01 * one for one in albedo.value] if isinstance(albedo.value, list) else 1.01 * albedo.value
        return replace(found, parameters={**found.parameters, "albedo": replace(albedo, value=value)})

    monkeypatch.setattr(matest, "estimate", biased)
    code, out, _ = run("--suite", "efficiency", "--gate")
    assert code == 1
    table = out[out.index("Gate:") :]
    assert "efficiency: lambert" in table
    assert "albedo: rms error" in table
    assert "coverage" not in table
    assert max(len(line.rstrip()) for line in out.splitlines()) <= 80


def test_a_slowed_estimator_fails_by_its_cost(run, written, monkeypatch: pytest.MonkeyPatch) -> None:
    def estimate(capture: Any, *_: Any, **__: Any) -> Any:
        return SimpleNamespace(fit=SimpleNamespace(samples=len(capture.samples())))

    def takes(seconds: float) -> None:
        """Let every sample take so many seconds, whatever else the machine does."""

        def timed(work: Callable[[], Any]) -> tuple[Any, float]:
            return (done := work()), seconds * done.fit.samples

        monkeypatch.setattr(scaling, "timed", timed)

    monkeypatch.setattr(matest, "estimate", estimate)
    takes(1e-6)
    written("scaling")
    takes(1e-4)
    code, out, _ = run("--suite", "scaling", "--gate")
    assert code == 1
    assert "time per sample" in out[out.index("Gate:") :]


def test_a_slower_machine_fails_no_gate_on_accuracy(written, capfd: pytest.CaptureFixture[str]) -> None:
    records = written("efficiency")
    slow = Figure("efficiency", "lambert", "ratio", 1e-9, "lower", 0.0, "cost")
    found = baseline.read()
    baseline.write(Baseline(quick=(*found.quick, slow)))
    gate.main(str(records))
    out = capfd.readouterr().out
    assert "Gate: none of 5 figures is worse" in out
    assert "memory" in out
    assert "rms error" in out


def test_worse_accuracy_in_records_ends_with_code_1(written) -> None:
    records = written("efficiency")
    figures = baseline.read().quick
    better = (*figures[:-1], Figure("efficiency", "lambert", "rms error", 1e-3, "lower", 0.1, "accuracy"))
    baseline.write(Baseline(quick=better))
    with pytest.raises(SystemExit) as ended:
        gate.main(str(records))
    assert ended.value.code == 1


def test_a_figure_that_the_run_does_not_give_fails(run, written) -> None:
    written("efficiency")
    found = baseline.read()
    lost = Figure("efficiency", "ward", "rms error", 1.0, "lower", 0.1, "accuracy")
    baseline.write(Baseline(quick=(*found.quick, lost)))
    code, out, _ = run("--suite", "efficiency", "--gate")
    assert code == 1
    table = out[out.index("Gate:") :]
    assert "ward" in table
    assert "missing" in table


def test_the_verdict_keeps_out_of_machine_output(run, written) -> None:
    written("efficiency")
    code, out, err = run("--suite", "efficiency", "--gate", "--json")
    assert code == 0
    assert all(json.loads(line)["suite"] for line in out.splitlines())
    assert "Gate: none" in err


@pytest.mark.parametrize(
    ("text", "words"),
    [(None, "no such file"), ("{", "expected a baseline"), ('{"full": []}', "no figures of a quick run of")],
)
def test_a_bad_baseline_gets_one_sentence_that_names_it_and_exit_2(run, text: str | None, words: str) -> None:
    if text is not None:
        baseline.PATH.write_text(text, "utf-8")
    code, out, err = run("--suite", "efficiency", "--gate")
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert "tests/benchmark_baseline.json" in err
    assert words in err


@pytest.mark.parametrize(
    ("value", "fails"), [(1.1, False), (1.11, True), (float("nan"), True), (None, True), (0, False)]
)
def test_worse_means_beyond_the_tolerance_or_not_a_number(value: float | None, fails: bool) -> None:
    figure = Figure("s", "c", "m", 1.0, "lower", 0.1, "accuracy")
    assert bool(gate.worse([figure], [Record("s", "c", "m", value, "1")])) is fails


def test_a_whole_run_gives_long_suites_their_share_and_one_alone_all() -> None:
    def seconds_of(text: str, quick: bool) -> dict[str, float]:
        names, effort = benchmark.plan(text, quick=quick)
        given: dict[str, float] = {}
        for name in names:
            suite = replace(
                benchmark.load(name),
                measure=lambda effort, _, name=name: iter([given.update({name: effort.seconds})]),
            )
            list(suite.run(effort))
        return given

    assert seconds_of("efficiency", False)["efficiency"] == math.inf
    assert set(seconds_of("", True).values()) == {math.inf}
    shared = {name: seconds for name, seconds in seconds_of("", False).items() if seconds < math.inf}
    assert {"efficiency", "outliers", "stress"} <= set(shared)
    assert all(seconds == benchmark.load(name).share > 0 for name, seconds in shared.items())
    # Of half an hour, and the others need their own.
    assert sum(shared.values()) <= 1100
