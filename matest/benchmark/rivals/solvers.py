"""General solvers on the torch shader, as a good user of them would write it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import torch
from torch import Tensor

from matest.benchmark.instruments.task import Task, Trace, Values
from matest.parameters import Role
from matest.shading import shade
from matest.training.trainable import Trainable

_LBFGS_ITERATIONS = 200


class _OutOfTime(Exception):
    """Ends a solver that cannot be asked to stop."""


def adam(task: Task, batch: int | None, rate: float, done: Callable[[Trace], bool], *, compiled: bool = False) -> Trace:
    """Adam on all samples at every step, or on mini-batches of `batch` in random order.

    Args:
        task: what is fitted.
        batch: samples a step; None: all.
        rate: learning rate.
        done: whether to stop, asked after every step.
        compiled: whether torch compiles the cost of all samples, before the clock starts.
    """
    module = _module(task)
    cost = _cost(task, module, compiled)
    trace = Trace()
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
    """L-BFGS with strong-Wolfe line search; at any time it hands over what had the lowest cost.

    Args:
        task: what is fitted.
        compiled: as of `adam`.
        patience: seconds after which it ends.
    """
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
    """scipy's trust-region reflective solver with bounds and the Jacobian of torch's forward mode.

    Args:
        task: what is fitted.
        patience: seconds after which it ends.
    """
    from scipy.optimize import least_squares as solve

    trace, dtype = Trace(), task.radiance.dtype
    root, base = task.weight.sqrt(), task.start.to(task.radiance.dtype, "cpu")
    domains = {name: task.start.declared[name].domain for name in task.free}
    start = _spread(task, base.parameters)
    sizes = [len(value) for value in start.values()]
    lower, upper = (
        np.repeat([getattr(domain, end) for domain in domains.values()], sizes) for end in ("lower", "upper")
    )

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
        solution = solve(function, first, jac=jacobian, bounds=(lower, upper), method="trf", x_scale="jac")
        trace.add(unpack(solution.x))
    return trace


def _spread(task: Task, parameters: Values) -> Values:
    """The free parameters, those that differ by channel with a value for each."""
    channels, declared = task.radiance.shape[1], task.start.declared
    return {name: parameters[name].expand(channels if declared[name].per_channel else 1) for name in task.free}


def _check_time(trace: Trace, patience: float) -> None:
    """Hand over the last result once more when the time is up.

    Raises:
        _OutOfTime: then.
    """
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
