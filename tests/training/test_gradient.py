"""Training by stochastic gradients: any module, any optimiser, and runs that go on exactly where they stopped."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor, nn

import matest
from matest.brdf import Brdf, Lambert, OrenNayar
from matest.losses import likelihood
from matest.samples import Batch
from matest.scene import Surface
from matest.shading import shade
from matest.training.gradient import TrainingStep, fit_gradient
from tests.training.materials import SAMPLES, SIZE, STUDIO, Speckled, adam, lbfgs, same, sgd, squares, start, train


@pytest.mark.parametrize("optimiser", [sgd, adam, lbfgs], ids=["sgd", "adam", "lbfgs"])
@pytest.mark.parametrize("half", [4, 6], ids=["between-epochs", "mid-epoch"])
def test_a_resumed_run_ends_bit_for_bit_where_an_uninterrupted_one_does(tmp_path: Path, optimiser, half: int) -> None:
    whole, first, second = Speckled(), Speckled(), Speckled()
    uninterrupted = train(whole, 2 * half, optimiser)
    train(first, half, optimiser, checkpoint=tmp_path / "run.safetensors")
    # Nothing of the second module's own start may survive.
    with torch.no_grad():
        for parameter in second.parameters():
            parameter.add_(1.0)
    resumed = train(second, 2 * half, optimiser, checkpoint=tmp_path / "run.safetensors")
    assert same(second, whole)
    assert not same(first, whole)
    assert resumed == uninterrupted
    assert resumed.steps == 2 * half


@pytest.mark.parametrize("optimiser", [sgd, adam, lbfgs], ids=["sgd", "adam", "lbfgs"])
def test_after_an_interruption_the_last_complete_checkpoint_leads_to_the_same_end(tmp_path: Path, optimiser) -> None:
    def interrupt(step: TrainingStep) -> None:
        if step.step == 7:
            raise KeyboardInterrupt

    whole, broken, resumed = Speckled(), Speckled(), Speckled()
    uninterrupted = train(whole, 9, optimiser)
    options = {"checkpoint": tmp_path / "run.safetensors", "every": 3}
    with pytest.raises(KeyboardInterrupt):
        train(broken, 9, optimiser, callback=interrupt, **options)
    assert len(load_file(tmp_path / "run.safetensors")["losses"]) == 6
    assert train(resumed, 9, optimiser, **options) == uninterrupted
    assert same(resumed, whole)


def test_rates_that_a_callback_sets_are_resumed(tmp_path: Path) -> None:
    def decay(step: TrainingStep) -> None:
        for group in step.optimiser.param_groups:
            group["lr"] *= 0.8

    whole, part = start(), start()
    train(whole, 10, callback=decay)
    train(part, 5, callback=decay, checkpoint=tmp_path / "run")
    train(part, 10, callback=decay, checkpoint=tmp_path / "run")
    assert same(part, whole)
    assert not same(part, _trained(10))


def _trained(steps: int) -> nn.Module:
    material = start()
    train(material, steps)
    return material


def test_a_run_that_has_reached_its_limit_changes_nothing_when_called_again(tmp_path: Path) -> None:
    material = start()
    train(material, 5, checkpoint=tmp_path / "run")
    content, state = (tmp_path / "run").read_bytes(), material.state_dict()
    again = start()
    result = train(again, 5, checkpoint=tmp_path / "run")
    assert (result.steps, result.reason) == (5, "limit reached")
    assert torch.equal(again.state_dict()["values.0"], state["values.0"])
    assert (tmp_path / "run").read_bytes() == content


def test_two_threads_sum_the_gradient_of_a_texture_in_the_same_order() -> None:
    class Blurred(nn.Module):
        """Patches of albedo, each point the mean of 300 of them: sums long enough to be shared between threads."""

        def __init__(self) -> None:
            super().__init__()
            self.patches = nn.Parameter(torch.linspace(0.2, 0.8, 7)[:, None])

        def forward(self, batch: Batch) -> Brdf:
            assert batch.pixels is not None
            return Lambert(self.patches[(batch.pixels[:, None] * torch.arange(300)) % 7].mean(1))

    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        materials = [Blurred() for _ in range(4)]
        for material in materials:
            train(material, 4, batch_size=len(SAMPLES))
    finally:
        torch.set_num_threads(threads)
    assert all(same(material, materials[0]) for material in materials)


def test_the_material_is_recovered_with_every_optimiser() -> None:
    steep, quick = partial(torch.optim.SGD, lr=4.0, momentum=0.9), partial(torch.optim.Adam, lr=0.2)
    # L-BFGS takes no mini-batches: its curvature would be that of the noise between them.
    cases = ((steep, squares, 60, SIZE), (quick, likelihood, 40, SIZE), (lbfgs, likelihood, 8, len(SAMPLES)))
    for optimiser, loss, epochs, size in cases:
        material = start()
        fit_gradient(SAMPLES, material, optimiser=optimiser, loss=loss, epochs=epochs, batch_size=size)
        values = material().parameters
        assert values["albedo"].item() == pytest.approx(0.8, rel=0.02)
        assert values["sigma"].item() == pytest.approx(0.5, rel=0.05)


def test_the_loop_by_hand_and_fit_gradient_do_the_same() -> None:
    by_hand, fitted = start(), start()
    optimiser = adam(list(by_hand.parameters()))
    for epoch in range(2):
        for batch in SAMPLES.batches(SIZE, shuffle=True, seed=5 + epoch):
            loss = likelihood(shade(by_hand(), batch.points), batch)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
    fit_gradient(SAMPLES, fitted, optimiser=adam, epochs=2, batch_size=SIZE, seed=5)
    assert same(by_hand, fitted)


def test_a_texture_of_regions_finds_the_albedo_of_each() -> None:
    surface = STUDIO.scene.surface
    regions = (surface.positions[:, 0] > 0).long()
    painted = torch.where(regions == 0, 0.3, 0.7)[:, None]
    samples = STUDIO.photograph(Lambert(painted), seed=2).samples()

    class Regions(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.raw = nn.Parameter(torch.zeros(2, 1))

        def forward(self, batch: Batch) -> Brdf:
            return Lambert(torch.sigmoid(self.raw)[regions[batch.pixels]])

    material = Regions()
    fit_gradient(samples, material, epochs=40, batch_size=SIZE)
    assert torch.sigmoid(material.raw).flatten().tolist() == pytest.approx([0.3, 0.7], rel=0.01)


class Field(nn.Module):
    """A small network from the position of a point to its albedo and σ."""

    def __init__(self, surface: Surface) -> None:
        super().__init__()
        self.register_buffer("positions", surface.positions.float())
        self.network = nn.Sequential(nn.Linear(3, 16), nn.Tanh(), nn.Linear(16, 2))

    def forward(self, batch: Batch) -> Brdf:
        albedo, sigma = torch.sigmoid(self.network(self.positions[batch.pixels])).split(1, dim=-1)
        return OrenNayar(albedo, sigma)


def test_a_network_of_ones_own_learns_a_gradual_change() -> None:
    surface = STUDIO.scene.surface
    albedo = (0.5 + 0.3 * surface.positions[:, :1]).float()
    samples = STUDIO.photograph(OrenNayar(albedo, torch.full_like(albedo, 0.4)), seed=3).samples()
    torch.manual_seed(0)
    material = Field(surface)
    result = fit_gradient(samples, material, optimiser=adam, loss=squares, epochs=50, batch_size=SIZE)
    assert sum(result.losses[-4:]) < 0.02 * sum(result.losses[:4])
    everywhere = next(samples.batches(len(samples)))
    found = material(everywhere).parameters["albedo"]
    assert (found - albedo[everywhere.pixels]).square().mean().sqrt() < 0.05


def test_a_prior_is_one_more_term_of_the_loss() -> None:
    def with_prior(rendered: Tensor, batch: Batch) -> Tensor:
        off = (material().parameters["sigma"] - 0.1) / 1e-4
        return likelihood(rendered, batch) + 0.5 * off.square().sum() / len(SAMPLES)

    material = start()
    fit_gradient(SAMPLES, material, loss=with_prior, optimiser=lbfgs, epochs=20, batch_size=len(SAMPLES))
    assert material().parameters["sigma"].item() == pytest.approx(0.1, abs=2e-3)


def test_a_callback_follows_every_step_and_can_stop() -> None:
    seen: list[TrainingStep] = []

    def stop_at_six(step: TrainingStep) -> bool:
        seen.append(step)
        return step.step == 6

    result = fit_gradient(SAMPLES, start(), epochs=10, batch_size=SIZE, callback=stop_at_six)
    assert [(step.step, step.epoch) for step in seen] == [(1, 0), (2, 0), (3, 0), (4, 0), (5, 1), (6, 1)]
    assert tuple(step.loss for step in seen) == result.losses
    assert (result.steps, result.reason) == (6, "stopped by the callback")


def test_a_stopped_run_goes_on_from_where_it_stopped(tmp_path: Path) -> None:
    whole, part = start(), start()
    train(whole, 9)
    train(part, 9, callback=lambda step: step.step == 5, checkpoint=tmp_path / "run")
    train(part, 9, checkpoint=tmp_path / "run")
    assert same(part, whole)


def test_the_earlier_of_two_limits_counts() -> None:
    assert fit_gradient(SAMPLES, start(), epochs=2, steps=3, batch_size=SIZE).steps == 3
    assert fit_gradient(SAMPLES, start(), epochs=2, steps=30, batch_size=SIZE).steps == 8


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_loss_that_is_not_finite_ends_the_run_before_it_moves_anything(tmp_path: Path, bad: float) -> None:
    calls: list[int] = []

    def breaks(rendered: Tensor, batch: Batch) -> Tensor:
        calls.append(1)
        return squares(rendered, batch) * (bad if len(calls) == 4 else 1.0)

    material, three = start(), start()
    result = train(material, 9, loss=breaks, checkpoint=tmp_path / "run", every=2)
    assert (result.steps, result.reason) == (3, "loss not finite")
    train(three, 3)
    assert same(material, three)
    assert len(load_file(tmp_path / "run")["losses"]) == 2


def test_the_generators_and_modes_of_torch_are_left_as_they_were() -> None:
    torch.manual_seed(3)
    expected = torch.rand(4)
    torch.manual_seed(3)
    train(Speckled(), 3)
    assert torch.equal(torch.rand(4), expected)
    assert not torch.are_deterministic_algorithms_enabled()
    torch.use_deterministic_algorithms(True)
    try:
        train(Speckled(), 3)
        assert torch.are_deterministic_algorithms_enabled()
        assert not torch.is_deterministic_algorithms_warn_only_enabled()
    finally:
        torch.use_deterministic_algorithms(False)


def test_the_seed_decides_order_and_chance() -> None:
    runs = [train(Speckled(), 3, seed=seed).losses for seed in (1, 1, 2)]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_it_is_part_of_the_package() -> None:
    assert matest.fit_gradient is fit_gradient
