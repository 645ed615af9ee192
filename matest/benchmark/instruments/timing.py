"""Evaluating a model on many random directions, ready to be timed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable

import torch
from torch import Tensor

from matest.benchmark.instruments.passes import Pass

# Where the time levels off: smaller tiles pay for the calls and stay below the size that torch spreads over threads.
TILE = 65_536

Evaluate = Callable[[Tensor, Tensor], Tensor]


def forward(evaluate: Evaluate, wi: Tensor, wo: Tensor, tile: int) -> Pass:
    def run() -> None:
        with torch.no_grad():
            for light, view in zip(wi.split(tile), wo.split(tile), strict=True):
                evaluate(light, view)

    return run


def forward_and_backward(evaluate: Evaluate, wi: Tensor, wo: Tensor, tile: int) -> Pass:
    def run() -> None:
        for light, view in zip(wi.split(tile), wo.split(tile), strict=True):
            evaluate(light, view).sum().backward()

    return run


def random_directions(n: int) -> tuple[Tensor, Tensor]:
    """Random unit vectors [n, 3] above the horizon."""
    vectors = torch.randn(2, n, 3, generator=torch.Generator().manual_seed(0))
    vectors[..., 2].abs_()
    wi, wo = torch.nn.functional.normalize(vectors, dim=-1)
    return wi, wo


def no_compiler() -> str:
    """Why torch cannot compile here; empty where it can."""
    compiler = os.environ.get("CXX", "g++")
    return "" if shutil.which(compiler) else f"no C++ compiler here: {compiler}."
