"""General solvers on the torch shader, as a good user of them would write it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial

import numpy as np
import torch
from torch import Tensor

from matest.benchmark.instruments.task import CLOSE, Task, Trace, Values
from matest.parameters import Role
from matest.shading import shade
from matest.training.trainable import Trainable

# Iterations after which L-BFGS gives up.
_LBFGS_ITERATIONS = 200
# Adam has come to stay after this many steps in a row near the optimum.
SETTLED = 30
# A learning rate that takes so many times as long as the best so far has lost.
_LOST = 2.0

Done = Callable[[Trace], bool]


class _OutOfTime(Exception):
    """Ends a solver that cannot be asked to stop."""


def tuned(
    once: Callable[[float, Done], Trace],
    rates: Sequence[float],
    optimum: Values,
    patience: float,
    *,
    close: float = CLOSE,
    hurry: bool = True,
) -> list[Trace]:
    """A run of Adam for every learning rate.

    Args:
        once: a run, from the learning rate and whether to stop, asked after every step.
        rates: the most promising first.
        optimum: of the likelihood.
        patience: seconds after which a run ends.
        close: relative distance from the optimum at which it has arrived.
        hurry: whether runs end that take much longer than the best so far.
    """
    runs: list[Trace] = []
    limit = patience
    for rate in rates:
        runs.append(once(rate, partial(finished, optimum=optimum, limit=limit, close=close)))
        arrived = runs[-1].arrival(optimum)
        if hurry and arrived is not None:
            limit = min(limit, _LOST * arrived)
    return runs


def finished(trace: Trace, optimum: Values, limit: float, close: float = CLOSE) -> bool:
    """Whether Adam has come to stay near the optimum, or its time is up."""
    return trace.settled(optimum, SETTLED, close) or trace.elapsed > limit


def adam(task: Task, batch: int | None, rate: float, done: Done, *, compiled: bool = False) -> Trace:
    """Adam at a learning rate, until `done`, which is asked after every step.

    Args:
        batch: samples a step, in random order; None: all.
        compiled: whether torch compiles the cost of all samples, before the clock starts.
    """
    module = _module(task)
    cost = _cost(task, module, compiled)
    size = "all samples" if batch is None else f"{batch:,} samples"
    trace = Trace(rate=rate, note=f"learning rate {rate:g}, {size} a step")
    optimiser = torch.optim.Adam(module.parameters(), lr=rate)
    generator = torch.Generator().manual_seed(0)
    while True:
        order = None if batch is None else torch.randperm(len(task.radiance), generator=generator)
        for part in [task] if order is None or batch is None else (task[index] for index in order.split(batch)):
            loss = cost() if part is task else part.cost(module())
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            trace.add(_values(module, task))
            if done(trace):
                return trace


def lbfgs(task: Task, *, compiled: bool = False, patience: float = math.inf) -> Trace:
    """L-BFGS with strong-Wolfe line search, for so many seconds; its results are those of the lowest cost yet."""
    module = _module(task)
    cost = _cost(task, module, compiled)
    trace = Trace()
    optimiser = torch.optim.LBFGS(module.parameters(), max_iter=_LBFGS_ITERATIONS, line_search_fn="strong_wolfe")
    lowest = torch.inf

    def closure() -> Tensor:
        nonlocal lowest
        _check_time(trace, patience)
        optimiser.zero_grad()
        loss = cost()
        loss.backward()
        if loss.item() < lowest:
            lowest = loss.item()
            trace.add(_values(module, task))
        return loss

    with suppress(_OutOfTime):
        optimiser.step(closure)
    return trace


def least_squares(task: Task, *, patience: float = math.inf) -> Trace:
    """scipy's trust-region reflective solver, for so many seconds, with the Jacobian of torch's forward mode."""
    from scipy.optimize import least_squares as solve

    trace, dtype = Trace(), task.radiance.dtype
    root, base = task.weight.sqrt(), task.start.to(dtype, "cpu")
    start = _spread(task, base.parameters)
    sizes = [len(value) for value in start.values()]
    domains = [task.start.declared[name].domain for name in task.free]
    bounds = tuple(np.repeat([getattr(domain, end) for domain in domains], sizes) for end in ("lower", "upper"))

    def unpack(x: object) -> Values:
        return dict(zip(task.free, torch.as_tensor(x, dtype=dtype).split(sizes), strict=True))

    def residual(x: object) -> Tensor:
        return (root * (shade(base.replace(unpack(x)), task.points) - task.radiance)).flatten()

    def jacobian(x: object) -> np.ndarray:
        # It is asked for where a step has been taken.
        trace.add(unpack(x))
        _check_time(trace, patience)
        return torch.func.jacfwd(residual)(torch.as_tensor(x, dtype=dtype)).double().numpy()

    def function(x: object) -> np.ndarray:
        with torch.no_grad():
            return residual(x).double().numpy()

    with suppress(_OutOfTime):
        first = torch.cat(list(start.values())).double().numpy()
        solution = solve(function, first, jac=jacobian, bounds=bounds, method="trf", x_scale="jac")
        trace.add(unpack(solution.x))
    return trace


def _spread(task: Task, parameters: Values) -> Values:
    """The free parameters, those that differ by channel with a value for each."""
    channels, declared = task.radiance.shape[1], task.start.declared
    return {name: parameters[name].expand(channels if declared[name].per_channel else 1) for name in task.free}


def _check_time(trace: Trace, patience: float) -> None:
    """When the time is up, hand over the last result once more and raise `_OutOfTime`."""
    if trace.elapsed > patience and trace.values:
        trace.add(trace.values[-1])
        raise _OutOfTime


def _cost(task: Task, module: Trainable, compiled: bool) -> Callable[[], Tensor]:
    """The cost of all samples as a function of the module's parameters."""

    def cost() -> Tensor:
        return task.cost(module())

    if compiled:
        torch.compiler.reset()
        cost = torch.compile(cost)
        with warnings.catch_warnings(action="ignore"):
            cost().backward()
    return cost


def _module(task: Task) -> Trainable:
    declared = task.start.declared
    spread = {name: value for name, value in _spread(task, task.start.parameters).items() if declared[name].per_channel}
    fixed = tuple(name for name in declared if name not in task.free and declared[name].role is not Role.GAUGE)
    return Trainable(task.start.replace(spread), fixed=fixed)


def _values(module: Trainable, task: Task) -> Values:
    with torch.no_grad():
        parameters = module().parameters
    return {name: parameters[name] for name in task.free}
