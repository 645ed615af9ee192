"""Training by stochastic gradients: any module, any optimiser, and runs that go on exactly where they stopped."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

import matest
from matest.brdf import Brdf, Lambert, OrenNayar
from matest.capture import Batch, Samples
from matest.estimators.gradient import GradientFit, TrainingStep, fit_gradient
from matest.losses import likelihood, photometric
from matest.scene import Surface
from matest.shader import shade
from matest.trainable import Trainable
from tests.captures import directional, refusal
from tests.simulated import Studio

TRUTH = OrenNayar(0.8, 0.5)
STUDIO = Studio(size=24)
SAMPLES = STUDIO.photograph(TRUTH, seed=1).samples()
# Four batches an epoch, the last one short.
SIZE = len(SAMPLES) // 4 + 7


def sgd(parameters: list[nn.Parameter]) -> torch.optim.Optimizer:
    return torch.optim.SGD(parameters, lr=1e-3, momentum=0.9)


def adam(parameters: list[nn.Parameter]) -> torch.optim.Optimizer:
    return torch.optim.Adam(parameters, lr=0.02)


def lbfgs(parameters: list[nn.Parameter]) -> torch.optim.Optimizer:
    return torch.optim.LBFGS(parameters, lr=0.5, max_iter=4, history_size=3, line_search_fn="strong_wolfe")


class Speckled(nn.Module):
    """A texture of albedo that drops out at random, a common σ, and a count of its calls."""

    def __init__(self) -> None:
        super().__init__()
        self.texture = nn.Parameter(torch.zeros(len(STUDIO.scene.surface), 1))
        self.sigma = Trainable(OrenNayar(0.5, 0.3), fixed=("albedo",))
        self.register_buffer("calls", torch.tensor(0))

    def forward(self, batch: Batch) -> Brdf:
        self.calls += 1
        albedo = torch.sigmoid(self.texture[batch.pixels])
        kept = torch.rand_like(albedo) < 0.9
        return OrenNayar(albedo * kept, self.sigma().parameters["sigma"])


def squares(rendered: Tensor, batch: Batch) -> Tensor:
    return photometric(rendered, batch.radiance)


def start() -> Trainable:
    return Trainable(OrenNayar(0.5, 0.3))


def same(one: nn.Module, other: nn.Module) -> bool:
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(a, b) for a, b in pairs)


def train(material: nn.Module, steps: int, optimiser=adam, **options: object) -> GradientFit:
    chosen = {"loss": squares, "batch_size": SIZE, **options}
    return fit_gradient(SAMPLES, material, optimiser=optimiser, steps=steps, **chosen)


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


def written(path: Path) -> Path:
    train(start(), 2, checkpoint=path / "run.safetensors")
    return path / "run.safetensors"


OTHERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "model": ("material", lambda path: train(Trainable(Lambert(0.5)), 4, checkpoint=path)),
    "options": (
        "material",
        lambda path: train(Trainable(OrenNayar(0.5, 0.3, interreflection=0.0)), 4, checkpoint=path),
    ),
    "precision": ("material", lambda path: train(start().double(), 4, checkpoint=path)),
    "method": ("optimiser", lambda path: train(start(), 4, sgd, checkpoint=path)),
    "rate": ("optimiser", lambda path: train(start(), 4, partial(torch.optim.Adam, lr=0.3), checkpoint=path)),
    "loss": ("loss", lambda path: train(start(), 4, loss=likelihood, checkpoint=path)),
    "batch-size": ("batch_size", lambda path: train(start(), 4, batch_size=SIZE + 1, checkpoint=path)),
    "seed": ("seed", lambda path: train(start(), 4, seed=9, checkpoint=path)),
    "photographs": ("set of samples", lambda path: elsewhere(STUDIO.photograph(TRUTH, seed=2).samples(), path)),
    "images": ("set of samples", lambda path: elsewhere(SAMPLES.capture.samples([0, 1]), path)),
    "lights": (
        "set of samples",
        lambda path: elsewhere(
            Studio(size=24, lights=((STUDIO.lights[1][0],), *STUDIO.lights[1:]))
            .expose(STUDIO.clean(TRUTH), seed=1)
            .samples(),
            path,
        ),
    ),
}


def elsewhere(samples: Samples, path: Path) -> GradientFit:
    return fit_gradient(samples, start(), optimiser=adam, loss=squares, steps=4, batch_size=SIZE, checkpoint=path)


@pytest.mark.parametrize("change", OTHERS)
def test_a_checkpoint_of_other_settings_is_refused_by_what_differs(tmp_path: Path, change: str) -> None:
    path = written(tmp_path)
    content = path.read_bytes()
    what, call = OTHERS[change]
    message = refusal(lambda: call(path))
    assert message.startswith(f"{path}: this checkpoint was written with another {what};")
    assert path.read_bytes() == content


def test_a_fixed_value_belongs_to_the_material_of_a_checkpoint(tmp_path: Path) -> None:
    fixed = [Trainable(OrenNayar(albedo, 0.3), fixed=("albedo",)) for albedo in (0.5, 0.6)]
    train(fixed[0], 2, checkpoint=tmp_path / "run")
    assert "another material;" in refusal(lambda: train(fixed[1], 4, checkpoint=tmp_path / "run"))


def rewrite(path: Path, without: str) -> None:
    """The checkpoint again, lacking one entry of its state."""
    with safe_open(path, framework="pt") as file:
        metadata, tensors = file.metadata(), {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    save_file(tensors, path, {**metadata, "state": metadata["state"].replace(f'"{without}"', '"something"', 1)})


@pytest.mark.parametrize(
    "entry",
    ["settings", "epoch", "batch", "losses", "material", "values.0", "optimiser", "param_groups", "generator"],
)
def test_a_checkpoint_that_lacks_an_entry_is_refused_by_name(tmp_path: Path, entry: str) -> None:
    path = written(tmp_path)
    rewrite(path, without=entry)
    message = refusal(lambda: train(start(), 4, checkpoint=path))
    assert message.startswith(f"{path}: expected a checkpoint of fit_gradient")


def test_a_checkpoint_that_is_no_safetensors_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.txt").write_text("losses", "utf-8")
    assert "run.txt: expected a checkpoint" in refusal(lambda: train(start(), 4, checkpoint=tmp_path / "run.txt"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "give epochs, steps or both"),
        ({"epochs": 0}, "epochs must be a positive whole number; got 0."),
        ({"steps": 2.5}, "steps must be a positive whole number; got 2.5."),
        ({"steps": 1, "batch_size": 0}, "batch_size must be"),
        ({"steps": 1, "every": 0}, "every must be"),
        ({"steps": 1, "checkpoint": "nowhere/run"}, "nowhere/run: expected a file name in an existing folder"),
        ({"steps": 1, "checkpoint": "."}, ".: expected a file name"),
    ],
)
def test_a_schedule_that_makes_no_sense_is_refused(options: dict[str, object], words: str) -> None:
    assert words in refusal(lambda: fit_gradient(SAMPLES, start(), **options))


def test_a_module_that_returns_no_model_is_refused() -> None:
    class Colour(nn.Linear):
        def forward(self, batch: Batch) -> Tensor:
            return super().forward(batch.radiance)

    assert "must return a Brdf" in refusal(lambda: fit_gradient(SAMPLES, Colour(1, 1), steps=1))


def test_nothing_to_train_is_refused() -> None:
    frozen = Trainable(OrenNayar(0.5, 0.3), fixed=("albedo", "sigma"))
    assert "nothing to train" in refusal(lambda: fit_gradient(SAMPLES, frozen, steps=1))


@pytest.mark.parametrize(
    "loss",
    [lambda rendered, batch: (rendered - batch.radiance).square(), lambda rendered, _: rendered.detach().mean()],
    ids=["not-a-scalar", "detached"],
)
def test_a_loss_that_cannot_lead_anywhere_is_refused(loss) -> None:
    assert "the loss must be a scalar" in refusal(lambda: fit_gradient(SAMPLES, start(), steps=1, loss=loss))


def test_a_capture_without_usable_samples_is_refused() -> None:
    from_behind = Studio(size=24, lights=((directional((0.0, 0.0, -1.0)),),)).photograph(TRUTH)
    assert "no usable sample" in refusal(lambda: fit_gradient(from_behind.samples(), start(), steps=1))


def test_it_is_part_of_the_package() -> None:
    assert matest.fit_gradient is fit_gradient
