"""The verdict on the models that were tried, in sentences: what fits as well, and what nothing fits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import torch

from matest.brdf import Brdf
from matest.directions import to_local
from matest.estimation.comparison import Trial, is_better
from matest.estimation.selection import Selection

# Angles of a light to the camera that could tell two models apart, degrees.
_ANGLES = range(0, 125, 5)
# Normals along each axis of the disc of a sphere.
_NORMALS = 48
# Relative difference of the radiance by which a further photograph tells two models apart.
_TELLING = 0.02
# Factor by which a free mixture of all components has to come closer than the best model to be worth a word.
_CLOSER = 1.5
# Ratio of the errors of two models that are called equal.
_EQUAL_SCORE = 1.02
# Models that are named because they fit as well.
_MOST_RIVALS = 3
# Digits of the values of a model that fits as well.
_DIGITS = 2


def sentences(
    selection: Selection, refined: Sequence[str] = (), *, explained: bool = False, mapped: bool = False
) -> Iterator[str]:
    """What a person should know of the choice of the model.

    Args:
        selection: that was made, with the calibration as it is stated.
        refined: families of its errors that were estimated afterwards.
        explained: whether causes of residuals are told already.
        mapped: whether what one value for all pixels does not explain is left to maps.
    """
    best = selection.best
    if not best.holds and refined:
        yield (
            f"Models were compared with the calibration as it is stated, under which none predicts {selection.unit}s "
            f"left out to their noise; errors of {', '.join(refined)} were refined for the best of them."
        )
    elif not best.holds and not mapped:
        yield _nothing_holds(selection, explained)
    elif best.holds:
        yield from (_equivalent(best, rival) for rival in equivalents(best, selection.trials))
    if selection.unfit:
        scale = ", or take up the unknown strength of the lights" if selection.relative else ""
        models = ", ".join(selection.unfit)
        yield f"Not tried, since they lack a parameter that was fixed, freed or tied{scale}: {models}."


def equivalents(best: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """The closest trials that the best one does not beat, other than those that have all its components and more."""
    equal = [
        trial
        for trial in trials
        if trial is not best
        and trial.score < _EQUAL_SCORE * best.score
        and not is_better(best, trial)
        and not trial.recipe.components > best.recipe.components
    ]
    return sorted(equal, key=lambda trial: trial.score)[:_MOST_RIVALS]


def _nothing_holds(selection: Selection, explained: bool) -> str:
    best, error = selection.best, selection.best.score
    said = (
        f"No model of the catalogue predicts {selection.unit}s left out to their noise: the best, "
        f"{best.recipe.expression}, misses them by {best.relative_rmse:.2%} of the signal, {error:.2g} times the noise"
    )
    if error > _CLOSER * selection.mixture_error:
        return (
            f"{said}; a free mixture of the components of all models misses them by {selection.mixture_error:.2g} "
            "times the noise: the surface has more components than a model."
        )
    advice = (
        "it is not the model"
        if explained
        else "look for an albedo that varies, or for errors of lights, normals, ambient light or transfer"
    )
    return f"{said}; nor would a free mixture of the components of all models: {advice}."


def _equivalent(best: Trial, rival: Trial) -> str:
    angle, difference = telling_light(best.material, rival.material)
    values = ", ".join(_values(rival))
    mend = (
        f"a photograph with the light {angle}° from the camera would tell them apart (they differ there by "
        f"{difference:.0%})"
        if difference > _TELLING
        else f"no light within {_ANGLES[-1]}° of the camera would show a difference above {_TELLING:.0%}"
    )
    return (
        f"Not told apart here: {best.recipe.expression} ({best.surface}) and {rival.recipe.expression} "
        f"({rival.surface}: {values}) predict what was left out equally well; {mend}."
    )


def _values(trial: Trial) -> Iterator[str]:
    """Name and value of every free parameter of a trial."""
    problem = trial.left_out.problem
    for name, value in problem.values(trial.left_out.unknowns).items():
        if name in problem.free:
            numbers = [f"{number:.{_DIGITS}g}" for number in value.reshape(-1).tolist()]
            yield f"{name} {'/'.join(numbers)}"


def telling_light(first: Brdf, second: Brdf) -> tuple[int, float]:
    """The angle of a light to the camera, in degrees, at which two materials differ most on a sphere, and by how much.

    The difference is the rms of the radiance over the visible side, relative to that under the brightest of the lights.
    """
    x = torch.linspace(-1, 1, _NORMALS, dtype=torch.float64)
    x, y = torch.meshgrid(x, x, indexing="xy")
    z2 = 1 - x.square() - y.square()
    normals = torch.stack([x, y, z2.clamp(min=0).sqrt()], dim=-1)[z2 > 0]
    differences, signals = [], []
    for angle in _ANGLES:
        light = torch.tensor([math.sin(math.radians(angle)), 0.0, math.cos(math.radians(angle))]).double()
        lit = normals[normals @ light > 0]
        wi, wo = to_local(lit, light.expand_as(lit), torch.tensor([0.0, 0.0, 1.0]).double().expand_as(lit))
        one, other = (material(wi, wo) * wi[:, 2:] for material in (first, second))
        signals.append(math.sqrt(float(one.square().sum()) / len(normals)))
        differences.append(math.sqrt(float((one - other).square().sum()) / len(normals)))
    worst = max(range(len(differences)), key=differences.__getitem__)
    return _ANGLES[worst], differences[worst] / max(signals)
