"""A small capture and what trains on it."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from matest.brdf import Brdf, OrenNayar
from matest.losses import photometric
from matest.samples import Batch
from matest.training.gradient import GradientFit, fit_gradient
from matest.training.trainable import Trainable
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
