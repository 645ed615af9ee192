"""Adam with a value at every pixel, on the shader and the samples that matest has, as a good user would write it."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from matest.benchmark.instruments.varying import Kind
from matest.brdf import Brdf
from matest.capture import Capture
from matest.losses import photometric
from matest.samples import Batch
from matest.shading import at_pixels, shade
from matest.training.trainable import Trainable

# It has stalled where so many steps
_WINDOW = 50
# make the loss no smaller than by this share.
_STALLED = 1e-4
# Where parameters start that all pixels share: the middle of their domain.
_MIDDLE = 0.5


@dataclass(frozen=True)
class MapContest:
    """What Adam is given.

    Attributes:
        start: the model at one value for all pixels.
        fixed: parameters that do not train.
        maps: parameters with a value at every pixel.
        texels: number of pixels.
        batch: all samples [n].
        weight: inverse variance of the noise [n, C].
    """

    start: Brdf
    fixed: tuple[str, ...]
    maps: tuple[str, ...]
    texels: int
    batch: Batch
    weight: Tensor

    @classmethod
    def of(cls, kind: Kind, capture: Capture, truth: Brdf) -> MapContest:
        """Adam knows the true noise, and starts in the middle of what the truth of maps is drawn from."""
        samples, texels = capture.samples(), len(capture.scene.surface)
        batch = next(samples.batches(len(samples)))
        assert batch.pixels is not None
        with torch.no_grad():
            radiance = shade(at_pixels(truth, batch.pixels, texels), batch.points)
        weight = batch.weight(radiance).float()
        middles = {name: sum(ends) / 2 for name, ends in kind.ranges.items()} | dict.fromkeys(kind.shared, _MIDDLE)
        counts = {name: capture.channels if truth.declared[name].per_channel else 1 for name in middles}
        start = truth.replace({name: torch.full((counts[name],), middle) for name, middle in middles.items()})
        return cls(start, tuple(kind.fixed), tuple(kind.ranges), texels, batch, weight)


class Descent(NamedTuple):
    """One run of Adam.

    Attributes:
        rate: the learning rate.
        steps: that it took.
        seconds: processor time of these.
        loss: at the end: mean squared residual in units of the noise.
        values: of every parameter at the end, [N, 1 or C] of maps.
    """

    rate: float
    steps: int
    seconds: float
    loss: float
    values: Mapping[str, Tensor]

    @property
    def account(self) -> str:
        """What the run was, in a few words."""
        return f"learning rate {self.rate:g}, {self.steps} steps, {self.seconds:.1f} s, loss {self.loss:.4g}"


def descend(contest: MapContest, rate: float, steps: int, patience: float = math.inf) -> Descent:
    """Adam on all samples at once, until it stalls, or steps or time are up.

    Args:
        contest: what it is given.
        rate: the learning rate.
        steps: at most.
        patience: processor seconds after which it ends.
    """
    batch, weight = contest.batch, contest.weight
    module = Trainable(contest.start, fixed=contest.fixed, maps=contest.maps, texels=contest.texels)
    optimiser = torch.optim.Adam(module.parameters(), lr=rate)
    scale, begin, losses = float(weight.mean()), time.process_time(), [math.inf]
    while not _stalled(losses) and len(losses) <= steps and time.process_time() - begin < patience:
        loss = photometric(shade(module(batch), batch.points), batch.radiance, weight)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(scale * loss.item())
    seconds = time.process_time() - begin
    with torch.no_grad():
        values = {name: value.clone() for name, value in module().parameters.items()}
    return Descent(rate, len(losses) - 1, seconds, losses[-1], values)


def _stalled(losses: Sequence[float]) -> bool:
    """Whether the lowest loss of the last steps is hardly below that of all before."""
    before, last = losses[:-_WINDOW], losses[-_WINDOW:]
    return len(before) > _WINDOW and min(last) > (1 - _STALLED) * min(before)
