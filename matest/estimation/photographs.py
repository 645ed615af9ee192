"""How well each photograph is described, and which of them stand out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import normalize

from matest.estimators import Solution
from matest.estimators.statistics import statistics_of
from matest.estimators.texels.maps import LEAST_LEFT
from matest.inference.image_errors import ImageErrors, image_errors
from matest.samples import Batch
from matest.samples.account import CalibratedSamples
from matest.scene import Light, Scene

# With fewer images the others do not tell which one is odd.
_MIN_IMAGES = 3
# Times that an error of one image is larger than is usual among many others, if it stands out.
_TIMES = 4.0
# The same of the rms residual that no turn or level explains, which chance hardly changes.
_TIMES_MISFIT = 3.0
# Images about whose number chance doubles what is usual among so few.
_FEW_IMAGES = 8
# Standard errors that an error has at least, if it stands out.
_SIGNIFICANT = 6.0
# The least that is worth a word: share of an image's brightness, and turn of a light.
_MIN_EXCESS = 0.005
_MIN_TURN = math.radians(0.25)
# Rms over median of normal deviates, and of the length of such ones in a plane.
_RMS_OF_NORMAL = 1.4826
_RMS_OF_PLANAR = 1.2011
# Per cent from which on two digits are not enough.
_ROUNDED = 99.5
# Photographs that a sentence names.
_MAX_NAMED = 3


@dataclass(frozen=True)
class Turn:
    """The turn of a photograph's lights that would explain its residual best.

    Attributes:
        degrees: by how much, if its brightness may be wrong too.
        std: standard error, degrees.
        toward: unit vector to where the light would stand, in the coordinates of the capture; None where a photograph
            has several lights, which turn together.
    """

    degrees: float
    std: float
    toward: list[float] | None


@dataclass(frozen=True)
class PhotographFit:
    """How well one photograph is described.

    Attributes:
        file: its name.
        relative_rmse: rms residual over rms signal of its usable values, as in `Fit`.
        level: factor by which it is brighter than a model of the other photographs predicts, if its light may also
            stand elsewhere; by weighted least squares; None where they do not tell.
        level_std: standard error of the factor; None likewise.
        reduced_chi2: mean squared residual in units of the noise variance.
        direction: the turn of its light; None where it has none, or no small turn explains what is odd about it.
        stands_out: what is odd beside the others: "level", "direction", "misfit" (which neither explains) or nothing.
        times: that error over what is usual among the others; 0 if nothing stands out.
    """

    file: str
    relative_rmse: float
    level: float | None
    level_std: float | None
    reduced_chi2: float
    direction: Turn | None
    stands_out: str = ""
    times: float = 0.0


def photograph_fits(
    solution: Solution, samples: CalibratedSamples, scene: Scene, drawn: tuple[Batch, float]
) -> list[PhotographFit]:
    """How well each of the fitted photographs is described; those without a usable pixel are left out.

    Args:
        solution: of the fit.
        samples: that were fitted.
        scene: that they are photographs of.
        drawn: `few_samples`, which tell of level and direction.
    """
    errors, account = image_errors(solution, samples, drawn, _oddest), samples.account
    by_image = solution.statistics.regrouped(samples.groups.image)
    row_of = {int(label): row for row, label in enumerate(by_image.labels)}
    positions = scene.surface.positions
    middle = None if positions is None else positions.double().mean(0, keepdim=True)
    fits = []
    for row, position in enumerate(errors.images.tolist()):
        image, scores = account.images[position], by_image.only(row_of[position])
        kind, times = _odd_side(errors, row) if errors.freed[row] else ("", 0.0)
        fits.append(
            PhotographFit(
                file=account.names[image],
                relative_rmse=scores.relative_rmse,
                level=_known(1 + errors.excess[row]),
                level_std=_known(errors.excess_std[row]),
                reduced_chi2=scores.reduced_chi2,
                direction=_turn(errors, row, scene.lights[image], middle),
                stands_out=kind,
                times=times,
            )
        )
    return fits


def mapped_photograph_fits(scores: Tensor, names: Sequence[str], degrees: Tensor) -> list[PhotographFit]:
    """How well a material with maps describes photographs; those without a usable pixel are left out.

    Nothing is said of their lights: what a map takes of a photograph that is odd the others do not tell.

    Args:
        scores: of every photograph, see `SCORES` [I, S].
        names: of the I photographs.
        degrees: of freedom that maps take of each [I]; where they take nearly all, χ² tells nothing and is 1.
    """
    fits = []
    for name, of_image, taken in zip(names, scores, degrees.tolist(), strict=True):
        image = statistics_of(of_image[None])
        if image.total("samples"):
            values = image.total("values")
            left = values - taken
            chi2 = image.total("chi2") / left if left > LEAST_LEFT * values else 1.0
            fits.append(PhotographFit(name, image.relative_rmse, None, None, chi2, None))
    return fits


def _known(value: Tensor) -> float | None:
    return None if bool(value.isnan()) else float(value)


def _turn(errors: ImageErrors, row: int, lights: Sequence[Light], middle: Tensor | None) -> Turn | None:
    """The turn of the lights of an image about the object's middle [1, 3]; None: all are distant."""
    if bool(errors.turn[row].isnan().any()):
        return None
    toward = None
    if len(lights) == 1:
        stated = lights[0].at(middle)[0][0].double()
        toward = normalize(stated + torch.linalg.cross(errors.turn[row], stated), dim=0).tolist()
    return Turn(math.degrees(float(errors.angle[row])), math.degrees(float(errors.turn_std[row])), toward)


def _oddest(errors: ImageErrors) -> int | None:
    """The image that stands out most of those that do not yet."""
    if len(errors.images) < _MIN_IMAGES:
        return None
    rest = (~errors.freed).nonzero()[:, 0].tolist()
    # Odd ones are a minority.
    if 2 * len(rest) <= len(errors.images) + 1:
        return None
    limits = dict.fromkeys(("level", "direction"), _TIMES * (1 + _FEW_IMAGES / len(rest))) | {"misfit": _TIMES_MISFIT}
    sides = {row: _odd_side(errors, row) for row in rest}
    beyond = {row: times / limits[side] for row, (side, times) in sides.items()}
    row = max(beyond, key=lambda each: beyond[each])
    return row if beyond[row] > 1 else None


def _odd_side(errors: ImageErrors, row: int) -> tuple[str, float]:
    """In what an image is the oddest, and how many times as far off as the others."""
    others = ~errors.freed
    others[row] = False
    misfit = math.sqrt(float(errors.left[row]) / max(_middle(errors.left[others]), 1.0))
    if misfit > _TIMES_MISFIT:
        return "misfit", misfit
    # A single image that is too bright makes all others look too dark.
    excess = (errors.excess - _middle(errors.excess[others])).abs()
    sides = {
        "level": _times(excess, errors.excess_std, row, others, _MIN_EXCESS, _RMS_OF_NORMAL),
        "direction": _times(errors.angle, errors.turn_std, row, others, _MIN_TURN, _RMS_OF_PLANAR),
    }
    side = max(sides, key=lambda each: sides[each])
    return side, sides[side]


def _times(size: Tensor, std: Tensor, row: int, others: Tensor, least: float, rms: float) -> float:
    """How many times as large as is usual among others an error is; 0 for one that is small, unknown or chance."""
    if not float(size[row]) > max(least, _SIGNIFICANT * float(std[row])):
        return 0.0
    return float(size[row]) / max(rms * _middle(size[others]), float(std[row]))


def _middle(values: Tensor) -> float:
    """The median of those that are known; 0 where none is."""
    known = values[~values.isnan()]
    return float(known.quantile(0.5)) if len(known) else 0.0


def standing_out(fits: Sequence[PhotographFit]) -> Iterator[str]:
    """A sentence that names the photographs that stand out; nothing where none does."""
    odd = sorted((fit for fit in fits if fit.stands_out), key=lambda fit: -fit.times)
    if not odd:
        return
    named = odd[:_MAX_NAMED]
    more = f" (and {len(odd) - len(named)} more)" if len(odd) > len(named) else ""
    times = _enumerated([f"{fit.times:.0f}" for fit in named])
    check = "its light, its exposure and whether it shows"
    if len(odd) > 1:
        check = "their lights, their exposures and whether they show"
    yield (
        f"{_enumerated([_oddity(fit) for fit in named])}{more}: {times} times as far off as is usual among the other "
        f"photographs. Check {check} the same object."
    )


def _oddity(fit: PhotographFit) -> str:
    """What is odd about a photograph, as a clause."""
    if fit.stands_out == "direction" and fit.direction is not None:
        return f"{fit.file}'s light stands {fit.direction.degrees:.2g}° off"
    if fit.stands_out == "misfit" or fit.level is None:
        return f"{fit.file} is explained by no level and no turn of its light"
    per_cent = 100 * abs(fit.level - 1)
    much = f"{per_cent:.2g}" if per_cent < _ROUNDED else f"{per_cent:.0f}"
    return f"{fit.file} is {much} % too {'bright' if fit.level > 1 else 'dark'} for its light"


def _enumerated(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
