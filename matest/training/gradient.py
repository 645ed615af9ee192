"""A training loop over mini-batches, for any torch optimiser and any module that returns a reflectance model."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from matest.brdf import Brdf
from matest.errors import InputError
from matest.losses import likelihood
from matest.samples import Batch, Samples
from matest.shading import shade
from matest.training.checkpoint import read_checkpoint, unusable, write_checkpoint

Loss = Callable[[Tensor, Batch], Tensor]
MakeOptimiser = Callable[[list[nn.Parameter]], torch.optim.Optimizer]


@dataclass(frozen=True)
class Schedule:
    """Length of a training, its batches, and the file of its state.

    Attributes:
        epochs: passes over all samples.
        steps: optimiser steps; training ends at the earlier of the two limits, and needs one of them.
        batch_size: samples a step; the last batch of an epoch may be smaller.
        seed: of the order of the samples (epoch e is shuffled with seed + e) and of torch's generator.
        checkpoint: safetensors file that the state is written to, and read from if it exists.
        every: steps from one writing of the file to the next; the end of the training writes it too.
    """

    epochs: int | None = None
    steps: int | None = None
    batch_size: int = 65_536
    seed: int = 0
    checkpoint: str | Path | None = None
    every: int = 100

    def __post_init__(self) -> None:
        if self.epochs is None and self.steps is None:
            raise InputError("fit_gradient needs a limit and got none: give epochs, steps or both.")
        for name in ("epochs", "steps", "batch_size", "every"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, int) and value >= 1):
                raise InputError(f"{name} must be a positive whole number; got {value}.")
        file = None if self.checkpoint is None else Path(self.checkpoint).absolute()
        if file is not None and (file.is_dir() or not file.parent.is_dir()):
            raise InputError(f"{self.checkpoint}: expected a file name in an existing folder; make the folder first.")


@dataclass(frozen=True)
class TrainingStep:
    """The state of a training after a step, for callbacks.

    Attributes:
        step: its number, from 1.
        epoch: the pass over the samples that it belongs to, from 0.
        loss: of its batch, before the step.
        optimiser: whose `param_groups` a callback may change, such as the learning rate.
    """

    step: int
    epoch: int
    loss: float
    optimiser: torch.optim.Optimizer


@dataclass(frozen=True)
class GradientFit:
    """The course of a training; its result is in the module.

    Attributes:
        losses: of the batch of each step before that step, also of steps before an interruption.
        reason: why it ended: "limit reached", "stopped by the callback" or "loss not finite".
    """

    losses: tuple[float, ...]
    reason: str

    @property
    def steps(self) -> int:
        return len(self.losses)


def _adam(parameters: list[nn.Parameter]) -> torch.optim.Optimizer:
    return torch.optim.Adam(parameters, lr=0.05)


def fit_gradient(
    samples: Samples,
    material: nn.Module,
    *,
    optimiser: MakeOptimiser = _adam,
    loss: Loss = likelihood,
    callback: Callable[[TrainingStep], bool | None] | None = None,
    **schedule: Any,
) -> GradientFit:
    """Train a module on samples by stochastic gradients; the module is changed in place.

    Each step shades one batch, shuffled over all images: loss(shade(material(batch), batch.points), batch).

    With `checkpoint`, a run that was interrupted goes on from the last complete file when it is called again in the
    same way, and ends bit for bit where it would have ended uninterrupted: parameters, buffers, the optimiser's state,
    the order of the samples and torch's generator are restored. `steps` and `epochs` may be raised in between. The loop
    uses torch's deterministic algorithms, and leaves torch's generators as it found them. What the module draws from
    other generators (numpy's, Python's), and what a learning-rate scheduler counts, is not kept: set rates in the
    callback from `step`.

    Args:
        samples: from `capture.samples()`.
        material: called with a `Batch` of n samples, returns their `Brdf`: a `Trainable`, or a network that gives each
            sample parameters [n, 1 or C], from `batch.pixels` for example.
        optimiser: makes the optimiser from the parameters that require gradients; its `step` must take a closure, as
            those of `torch.optim` do, L-BFGS among them. Default: Adam with lr 0.05.
        loss: of the rendered radiance [n, C] and the batch, a scalar. A prior is a term more: since `likelihood` is a
            mean over n·C values, a negative log-prior counts divided by the number of values in all samples.
        callback: called after each step; the loop ends when it returns something true.
        schedule: `epochs`, `steps`, `batch_size`, `seed`, `checkpoint`, `every`: the attributes of `Schedule`.

    Raises:
        InputError: no usable samples, nothing to train, a material or loss that gives something else, a checkpoint
            that cannot be read or was written with another material, optimiser, loss, samples, batch size or seed.
    """
    plan = Schedule(**schedule)
    _check_kinds(samples, material, optimiser)
    free = [parameter for parameter in material.parameters() if parameter.requires_grad]
    if not free:
        raise InputError("the material has no parameter that requires gradients: there is nothing to train.")
    if not len(samples):
        raise InputError("the capture has no usable sample to train on: all are background, shadowed or saturated.")
    stepper = optimiser(free)
    if not isinstance(stepper, torch.optim.Optimizer):
        raise InputError(f"optimiser must return a torch.optim.Optimizer; got a {type(stepper).__name__}.")
    settings = {} if plan.checkpoint is None else _settings(material, stepper, loss, samples, plan)
    run = _Run(material, stepper, loss, samples, plan, settings)
    with _reproducible(samples.device, plan.seed):
        place, losses = run.resume()
        steps_in_file, reason = len(losses), "limit reached"
        remaining = None if plan.steps is None else max(plan.steps - len(losses), 0)
        for epoch, number, batch in islice(run.batches(place), remaining):
            try:
                losses.append(run.step(batch))
            except _NotFinite:
                return GradientFit(tuple(losses), "loss not finite")
            place = _Place(epoch, number + 1)
            if callback is not None and callback(TrainingStep(len(losses), epoch, losses[-1], stepper)):
                reason = "stopped by the callback"
                break
            if len(losses) % plan.every == 0:
                run.save(place, losses)
                steps_in_file = len(losses)
        if steps_in_file < len(losses):
            run.save(place, losses)
    return GradientFit(tuple(losses), reason)


def _check_kinds(samples: Samples, material: nn.Module, optimiser: MakeOptimiser) -> None:
    """Refuse objects that people easily take for one of these three."""
    if not isinstance(samples, Samples):
        raise InputError(f"fit_gradient takes samples, of capture.samples(); got a {type(samples).__name__}.")
    if not isinstance(material, nn.Module):
        raise InputError(
            f"fit_gradient trains a torch module, such as matest.Trainable(brdf); got a {type(material).__name__}."
        )
    if isinstance(optimiser, torch.optim.Optimizer) or not callable(optimiser):
        raise InputError(
            "optimiser must make one from the parameters, as lambda parameters: torch.optim.Adam(parameters, lr=0.05) "
            f"does; got a {type(optimiser).__name__}."
        )


class _NotFinite(Exception):
    """The loss of a batch is infinite or not a number."""


class _Place(NamedTuple):
    """The place of a run: the epoch, and the number of its batches that are over."""

    epoch: int
    batch: int


@dataclass(frozen=True)
class _Run:
    """Everything about a run that its steps do not change, and the steps."""

    material: nn.Module
    optimiser: torch.optim.Optimizer
    loss: Loss
    samples: Samples
    plan: Schedule
    settings: Mapping[str, str | int]

    def batches(self, place: _Place) -> Iterator[tuple[int, int, Batch]]:
        """The batches after a place, each with its epoch and its number in that epoch."""
        size, seed, epochs = self.plan.batch_size, self.plan.seed, self.plan.epochs
        for epoch in count(place.epoch) if epochs is None else range(place.epoch, epochs):
            skip = place.batch if epoch == place.epoch else 0
            rest = self.samples.batches(size, shuffle=True, seed=seed + epoch, skip=skip)
            for number, batch in enumerate(rest, skip):
                yield epoch, number, batch

    def step(self, batch: Batch) -> float:
        """Take one step of the optimiser and return the loss before it; one that is not finite changes no parameter."""
        losses: list[float] = []

        def closure() -> Tensor:
            self.optimiser.zero_grad()
            loss = self._evaluate(batch)
            losses.append(float(loss.detach()))
            if not math.isfinite(losses[0]):
                raise _NotFinite
            loss.backward()
            return loss

        # torch types a closure as one that returns a number.
        self.optimiser.step(closure)  # type: ignore[arg-type]
        return losses[0]

    def _evaluate(self, batch: Batch) -> Tensor:
        brdf = self.material(batch)
        if not isinstance(brdf, Brdf):
            raise InputError(
                f"the material must return a Brdf when it is called with a batch; got a {type(brdf).__name__}. Return "
                "one of matest.brdf, such as Lambert(albedo=...)."
            )
        loss = self.loss(shade(brdf, batch.points), batch)
        if loss.ndim or not loss.requires_grad:
            raise InputError(
                f"the loss must be a scalar that depends on the material's parameters; got shape {list(loss.shape)}"
                f"{'' if loss.requires_grad else ' without gradient'}. Average over samples, and detach nothing."
            )
        return loss

    def save(self, place: _Place, losses: list[float]) -> None:
        if self.plan.checkpoint is None:
            return
        state = {
            "settings": self.settings,
            "epoch": place.epoch,
            "batch": place.batch,
            "losses": torch.tensor(losses, dtype=torch.float64),
            "material": self.material.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "generator": torch.get_rng_state(),
            "device_generator": torch.cuda.get_rng_state(self.samples.device) if self._on_gpu else None,
        }
        write_checkpoint(Path(self.plan.checkpoint), state)

    def resume(self) -> tuple[_Place, list[float]]:
        """Restore the state of the checkpoint, if there is one."""
        path = self.plan.checkpoint
        if path is None or not Path(path).exists():
            return _Place(0, 0), []
        state = read_checkpoint(Path(path))
        try:
            settings = state["settings"]
            differences = [name for name, value in self.settings.items() if settings[name] != value]
        except (KeyError, TypeError) as error:
            raise unusable(Path(path), error) from None
        if differences:
            raise InputError(
                f"{path}: this checkpoint was written with another {' and another '.join(differences)}; go on with "
                "what it was written with, or name another file."
            )
        try:
            self.material.load_state_dict(state["material"])
            self.optimiser.load_state_dict(state["optimiser"])
            torch.set_rng_state(state["generator"])
            if self._on_gpu:
                torch.cuda.set_rng_state(state["device_generator"], self.samples.device)
            return _Place(int(state["epoch"]), int(state["batch"])), state["losses"].tolist()
        except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
            raise unusable(Path(path), error) from None

    @property
    def _on_gpu(self) -> bool:
        return torch.device(self.samples.device).type == "cuda"


def _settings(
    material: nn.Module, optimiser: torch.optim.Optimizer, loss: Loss, samples: Samples, plan: Schedule
) -> dict[str, str | int]:
    """Properties that must agree so that a run can go on exactly, by their names in a refusal."""
    shapes = [f"{name}: {list(value.shape)} {value.dtype}" for name, value in material.named_parameters()]
    return {
        "material": "\n".join([repr(material), *shapes]),
        "optimiser": repr(optimiser),
        "loss": getattr(loss, "__qualname__", type(loss).__qualname__),
        "batch_size": plan.batch_size,
        "seed": plan.seed,
        "set of samples": _digest(samples),
    }


def _digest(samples: Samples) -> str:
    """A fingerprint of samples: their number, and the light, the view and the values of some of them."""
    some = next(samples.batches(4096, shuffle=True))
    digest = hashlib.sha256(repr((len(samples), some.radiance.dtype)).encode())
    points = some.points
    for value in (some.radiance, *some.noise.readout, points.wi, points.wo, points.irradiance, points.ambient):
        if value is not None:
            digest.update(value.detach().cpu().double().contiguous().numpy().tobytes())
    return digest.hexdigest()


@contextmanager
def _reproducible(device: torch.device | str, seed: int) -> Iterator[None]:
    """Seed torch's generators and ask for deterministic algorithms, and put both back afterwards."""
    gpu = [device] if torch.device(device).type == "cuda" else []
    before = torch.are_deterministic_algorithms_enabled(), torch.is_deterministic_algorithms_warn_only_enabled()
    with torch.random.fork_rng(devices=gpu):
        torch.random.default_generator.manual_seed(seed)
        if gpu:
            torch.cuda.manual_seed(seed)
        if not before[0]:
            # The gradient of a gather, such as a texture's, is otherwise summed in an order that changes.
            torch.use_deterministic_algorithms(True, warn_only=True)
        try:
            yield
        finally:
            torch.use_deterministic_algorithms(before[0], warn_only=before[1])
