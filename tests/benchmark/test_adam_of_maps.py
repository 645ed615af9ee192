"""Adam with a value at every pixel comes to the truth too, and ends when it has stalled or its time is up."""

from __future__ import annotations

import pytest
import torch

from matest.benchmark.instruments.photographs import sphere
from matest.benchmark.instruments.varying import KINDS, photographed, relative_errors
from matest.benchmark.rivals.adam_of_maps import MapContest, _stalled, descend
from matest.brdf import Brdf
from matest.workers import single_threaded_torch

KIND = KINDS["oren-nayar, albedo"]


@pytest.fixture(autouse=True)
def _one_thread():
    with single_threaded_torch():
        yield


@pytest.fixture(scope="module")
def contest() -> tuple[MapContest, Brdf]:
    subject = photographed(KIND, sphere(16), 6, seed=1)
    return MapContest.of(KIND, subject.photograph(), subject.material), subject.material


def test_it_is_given_the_true_noise_and_a_start_in_the_middle(contest: tuple[MapContest, Brdf]) -> None:
    given, truth = contest
    assert given.weight.shape == given.batch.radiance.shape
    assert given.start.parameters["albedo"].tolist() == pytest.approx([0.4] * 3)
    assert given.start.parameters["sigma"].tolist() == [0.5]
    assert truth.parameters["albedo"].shape == (given.texels, 3)


def test_it_comes_to_the_noise_and_near_the_truth(contest: tuple[MapContest, Brdf]) -> None:
    given, truth = contest
    run = descend(given, 0.1, 200)
    # Every pixel takes a degree of freedom of its few samples.
    assert 0.7 < run.loss < 1.05
    seen = given.batch.pixels.unique()
    assert float(relative_errors(run.values["albedo"], truth.parameters["albedo"])[seen].median()) < 0.02
    assert float(run.values["sigma"]) == pytest.approx(0.4, abs=0.02)
    assert f"learning rate 0.1, {run.steps} steps" in run.account


def test_it_ends_after_its_steps_and_when_its_time_is_up(contest: tuple[MapContest, Brdf]) -> None:
    assert descend(contest[0], 0.1, 3).steps == 3
    assert descend(contest[0], 0.1, 100, patience=0.0).steps == 0


def test_it_has_stalled_where_the_lowest_loss_of_late_is_no_lower() -> None:
    falling = [1 / (1 + step) for step in range(200)]
    assert not _stalled(falling)
    assert _stalled([*falling, *[falling[-1]] * 51])
    assert not _stalled(torch.linspace(2, 1, 60).tolist())
