"""What evaluating a model costs: its time, and the element-wise passes that it is made of."""

from __future__ import annotations

import math
import os
import shutil
import time
from collections.abc import Callable
from typing import Any, TypeVar

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

Pass = Callable[[], Any]
Evaluate = Callable[[Tensor, Tensor], Tensor]
Result = TypeVar("Result")

# The fastest of many counts: whatever else the machine does only adds time. Runs take turns, so that a slow spell of
# the machine meets all of them, for at least so many rounds
ROUNDS = 9
# and at least so many seconds.
SPELL = 0.1
# Pairs of directions in a tile, where the time levels off: smaller ones pay for the calls, and this one is still below
# the size that torch spreads over threads.
TILE = 65_536
# Results of fewer numbers are no pass: parameters, nodes of quadratures.
SHORT = 1000
# Numbers written for each pair of directions beyond which a model is a sum over many facets.
HEAVY = 1000


def random_directions(n: int) -> tuple[Tensor, Tensor]:
    """Random unit vectors [n, 3] above the horizon."""
    vectors = torch.randn(2, n, 3, generator=torch.Generator().manual_seed(0))
    vectors[..., 2].abs_()
    wi, wo = torch.nn.functional.normalize(vectors, dim=-1)
    return wi, wo


def forward(evaluate: Evaluate, wi: Tensor, wo: Tensor, tile: int, *, backward: bool = False) -> Pass:
    """A model's value on pairs of directions, tile by tile, and with `backward` its gradient too."""

    def run() -> None:
        with torch.set_grad_enabled(backward):
            for light, view in zip(wi.split(tile), wo.split(tile), strict=True):
                value = evaluate(light, view)
                if backward:
                    value.sum().backward()

    return run


def no_compiler() -> str:
    """Why torch cannot compile here; empty where it can."""
    compiler = os.environ.get("CXX", "g++")
    return "" if shutil.which(compiler) else f"no C++ compiler here: {compiler}."


def seconds(*runs: Pass) -> list[float]:
    """The shortest time that each of `runs` takes, after one round that is not measured."""
    return _fastest(lambda: [timed(run)[1] for run in runs])


def product(n: int, tile: int) -> Pass:
    """The unit of time: one element-wise product of two float32 tensors of `n` numbers, tile by tile, in place."""
    generator = torch.Generator().manual_seed(0)
    left, right = (torch.rand(n, generator=generator).split(tile) for _ in range(2))
    out = torch.empty(n).split(tile)

    def run() -> None:
        for a, b, c in zip(left, right, out, strict=True):
            torch.mul(a, b, out=c)

    return run


def element_wise(run: Pass) -> tuple[int, float]:
    """Numbers that the element-wise passes in `run` write, and the sum of the shortest times of each.

    A pass is an operation that makes a new tensor: views are free.
    """
    return sum(length for length, _ in _passes(run)), sum(_fastest(lambda: [seconds for _, seconds in _passes(run)]))


def heavy(evaluate: Evaluate) -> bool:
    """Whether a model is a sum over many facets, to be run on a tenth of the pairs."""
    direction = torch.tensor([0.6, 0.0, 0.8]).expand(SHORT, 3)
    return sum(length for length, _ in _passes(lambda: evaluate(direction, direction))) > HEAVY * SHORT


def _passes(run: Pass) -> list[tuple[int, float]]:
    """Length and seconds of every pass."""
    with torch.no_grad(), _Stopwatch() as watch:
        run()
    return watch.passes


class _Stopwatch(TorchDispatchMode):
    def __init__(self) -> None:
        super().__init__()
        self.passes: list[tuple[int, float]] = []

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        result, elapsed = timed(lambda: func(*args, **(kwargs or {})))
        if isinstance(result, Tensor) and result.numel() >= SHORT and not func.is_view:
            self.passes.append((result.numel(), elapsed))
        return result


def timed(run: Callable[[], Result]) -> tuple[Result, float]:
    """What a computation gives, and the seconds it takes."""
    start = time.perf_counter()
    result = run()
    return result, time.perf_counter() - start


def _fastest(round_of: Callable[[], list[float]]) -> list[float]:
    fastest = [math.inf] * len(round_of())
    rounds, begin = 0, time.perf_counter()
    while rounds < ROUNDS or time.perf_counter() - begin < SPELL:
        fastest = [min(pair) for pair in zip(fastest, round_of(), strict=True)]
        rounds += 1
    return fastest
