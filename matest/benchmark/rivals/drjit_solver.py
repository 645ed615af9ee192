"""Levenberg-Marquardt as one would write it by hand for a single model in Dr.Jit: one fused kernel an iteration."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from matest.benchmark.instruments.task import Task, Trace
from matest.benchmark.rivals.hand_written import DIELECTRIC, Facets, Normal, assembled, descend, facets

# Entries of the symmetric 3×3 normal matrix of a channel that are summed: body² does not depend on the slope.
_PAIRS = ((0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def levenberg_marquardt(task: Task, f0: float = 0.04) -> tuple[Trace, float]:
    """Fit `cook-torrance(masking=smith)` from the task's start, with the analytic Jacobian.

    What depends on the geometry alone is computed once by torch and handed over; every iteration reads it once, in
    vector instructions on all cores, and keeps 27 sums.

    Returns:
        the trace, which begins before the preparation, and the seconds that it took.

    Raises:
        ImportError: Dr.Jit or LLVM is missing.
    """
    import drjit as dr
    from drjit.llvm import Float

    trace = Trace()
    geometry = facets(task.points, f0, smith=True)
    light = task.points.irradiance[:, 0]

    def handed(column: Tensor) -> Any:
        return Float(column.float().contiguous().numpy())

    # Divided by the light of its channel, body and lobe are the same in every channel.
    white, bare = (handed((part / light)[:, 0]) for part in (geometry.body, geometry.carried))
    there = Facets(white, bare, handed(geometry.tan2[:, 0]), [handed(cot[:, 0]) for cot in geometry.cots])
    measured = [handed(column) for column in (task.radiance / light).unbind(1)]
    weights = [handed(column) for column in (task.weight * light.square()).unbind(1)]
    constant = (task.weight * geometry.body.square()).sum(0, dtype=torch.float64)
    dr.eval(*there, measured, weights)
    prepared = trace.elapsed
    channels = len(measured)

    def evaluate(unknowns: Tensor) -> Normal:
        # Opaque: a number in the code would mean compiling it anew every time.
        values = [dr.opaque(Float, float(value)) for value in unknowns]
        sums = torch.from_numpy(_sums(there, measured, weights, values).numpy()).double().reshape(channels, 9)
        normal = torch.zeros(channels, 3, 3, dtype=torch.float64)
        normal[:, 0, 0] = constant
        for number, (i, j) in enumerate(_PAIRS):
            normal[:, i, j] = normal[:, j, i] = sums[:, number]
        return assembled(sums[:, 8].sum(), normal, sums[:, 5:8])

    descend(DIELECTRIC, evaluate, task, trace)
    return trace, prepared


def _sums(there: Facets, measured: list[Any], weights: list[Any], unknowns: list[Any]) -> Any:
    """Nine sums over the samples a channel: entries `_PAIRS` of JᵀWJ, JᵀWr and the cost, as one kernel."""
    import drjit as dr
    from drjit.llvm import Float, UInt32

    *amplitudes, slope = unknowns
    channels = len(measured)
    lobe, bend = there.lobe(slope, dr.exp, dr.erf)
    sums = dr.zeros(Float, 9 * channels)
    for channel, (radiance, weight) in enumerate(zip(measured, weights, strict=True)):
        diffuse, specular = amplitudes[channel], amplitudes[channels + channel]
        columns = (there.body, lobe, specular * lobe * bend)
        residual = radiance - diffuse * there.body - specular * lobe
        weighted = [weight * column for column in columns]
        terms = [weighted[i] * columns[j] for i, j in _PAIRS] + [part * residual for part in weighted]
        for number, term in enumerate([*terms, weight * residual * residual]):
            dr.scatter_reduce(dr.ReduceOp.Add, sums, term, UInt32(9 * channel + number), mode=dr.ReduceMode.Local)
    return sums
