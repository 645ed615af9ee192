"""The element-wise passes that a computation is made of, and what each costs."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, TypeVar

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

Pass = Callable[[], Any]
Result = TypeVar("Result")

# The fastest of many counts: whatever else the machine does only adds time. Runs take turns, so that a slow spell of
# the machine meets all of them, for at least so many rounds,
ROUNDS = 9
# and at least so many seconds.
SPELL = 0.1
# Results of fewer numbers are no pass.
SHORT = 1000
# Numbers written for each pair of directions beyond which a model is a sum over many facets.
HEAVY = 1000


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

    A pass is an operation that makes a new tensor: views are free, parameters and nodes of quadratures are too short.
    """
    lengths: list[int] = []

    def walk() -> list[float]:
        with torch.no_grad(), _Stopwatch() as watch:
            run()
        lengths[:] = watch.lengths
        return watch.times

    times = _fastest(walk)
    return sum(lengths), sum(times)


def heavy(evaluate: Callable[[Tensor, Tensor], Tensor]) -> bool:
    """Whether a model is a sum over many facets, to be run on a tenth of the pairs."""
    direction = torch.tensor([0.6, 0.0, 0.8]).expand(SHORT, 3)
    with torch.no_grad(), _Stopwatch() as watch:
        evaluate(direction, direction)
    return sum(watch.lengths) > HEAVY * SHORT


class _Stopwatch(TorchDispatchMode):
    """Length and time of every pass."""

    def __init__(self) -> None:
        super().__init__()
        self.lengths: list[int] = []
        self.times: list[float] = []

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        result, elapsed = timed(lambda: func(*args, **(kwargs or {})))
        if isinstance(result, Tensor) and result.numel() >= SHORT and not func.is_view:
            self.lengths.append(result.numel())
            self.times.append(elapsed)
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
