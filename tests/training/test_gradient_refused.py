"""What training refuses, in a sentence: checkpoints of other settings, bad schedules, modules and losses."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from matest.brdf import Lambert, OrenNayar
from matest.losses import likelihood
from matest.photographs.samples import PhotographSamples
from matest.samples import Batch
from matest.training.gradient import GradientFit, fit_gradient
from matest.training.trainable import Trainable
from tests.captures import directional, refusal
from tests.simulated import Studio
from tests.training.materials import SAMPLES, SIZE, STUDIO, TRUTH, adam, sgd, squares, start, train


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
    "images": ("set of samples", lambda path: elsewhere(SAMPLES.photographs.samples([0, 1]), path)),
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


def elsewhere(samples: PhotographSamples, path: Path) -> GradientFit:
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


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"samples": Studio(size=24).photograph(TRUTH)}, "capture.samples()"),
        ({"material": OrenNayar(0.5, 0.3)}, "matest.Trainable(brdf)"),
        ({"optimiser": torch.optim.Adam(start().parameters())}, "make one from the parameters"),
        ({"optimiser": lambda _: None}, "torch.optim.Optimizer"),
    ],
)
def test_what_is_easily_given_instead_is_refused_by_name(given: dict, words: str) -> None:
    arguments = {"samples": SAMPLES, "material": start(), "steps": 1} | given
    assert words in refusal(lambda: fit_gradient(**arguments))


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
