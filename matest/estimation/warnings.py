"""What a user should know of an estimate, in sentences: small rules, each with its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import torch

from matest.estimation.specification import Specification
from matest.estimators import Solution
from matest.estimators.covariance import fisher
from matest.inference.derived import known_by_derived
from matest.inference.posterior import Posterior
from matest.inference.quantities import ParameterEstimate
from matest.parameters import OPTICS, Role
from matest.samples.account import Account, AccountedSamples

# The geometry should cover more than this share of the mask.
_COVERED = 0.5
# A relative rms error above this is poor.
_POOR = 0.15
# With a share of outliers above this a poor fit is not due to noise alone.
_SOME_OUTLIERS = 0.001
# A share of outliers above this is worth a word.
_MANY_OUTLIERS = 0.005
# χ² per value from which on an image is looked for that spoils it.
_MISFIT = 1.5
# Without an image that is odd χ² per value falls below this,
_MET = 1.1
# or to less than this share: a model that fits none of the images does not fit the others.
_SHARE = 0.1
# Of fewer images none is odd.
_FEW = 3


@dataclass(frozen=True)
class Context:
    """An estimate, for the rules on what to warn of.

    Attributes:
        samples: that it was made from.
        specification: what was asked for.
        solution, posterior: what came out.
        precision: that was asked for.
    """

    samples: AccountedSamples
    specification: Specification
    solution: Solution
    posterior: Posterior
    precision: float | None

    @property
    def account(self) -> Account:
        return self.samples.account

    @property
    def parameters(self) -> Mapping[str, ParameterEstimate]:
        return self.posterior.estimates

    def held(self, name: str) -> float:
        """The value that a parameter is held at."""
        return float(self.solution.problem.held[name])

    @cached_property
    def lost(self) -> list[str]:
        """What is not determined, lengths aside of which only a ratio is seen."""
        names = [name for name, parameter in self.parameters.items() if parameter.status == "not determined"]
        return [name for name in names if not known_by_derived(self.solution.problem, name)]

    @cached_property
    def lost_together(self) -> list[str]:
        """Those of them of which the samples see only a combination."""
        together = [name for name in self.lost if name in self.posterior.seen_together]
        return together if len(together) > 1 else []


def warnings(context: Context) -> list[str]:
    """What a user should know of an estimate, in sentences."""
    return [warning for rule in RULES for warning in rule(context)]


def _relative_radiometry(context: Context) -> Iterator[str]:
    if context.samples.relative:
        yield "The common scale of the lights is unknown (relative radiometry): albedo is reported up to that scale."


def _held_by_default(context: Context) -> Iterator[str]:
    for name in context.specification.default_held:
        fresnel = context.solution.problem.declared(name).role is Role.FRESNEL
        beside = " beside the strength of the highlight" if fresnel else ""
        yield (
            f"{name} is held at {context.held(name):g}: these images do not determine it{beside}; "
            f"--free {name} estimates it all the same, --fix {name}=VALUE sets it."
        )


def _f0_too_low(context: Context) -> Iterator[str]:
    """An amplitude at its upper end where the model does not hold: its lobe is brighter than `f0` lets it be."""
    problem = context.solution.problem
    held = context.specification.default_held
    # By the component of a sum that they belong to.
    fresnel = {name.rpartition(".")[0]: name for name in held if problem.declared(name).role is Role.FRESNEL}
    for name, parameter in context.parameters.items():
        f0 = fresnel.get(name.rpartition(".")[0])
        declared = problem.brdf.declared.get(name)
        if declared is None or f0 is None or parameter.status != "at bound" or context.posterior.bars.holds:
            continue
        values = problem.values(context.solution.unknowns)[name]
        if bool((values >= declared.domain.upper).any()) and name in problem.factors:
            yield (
                f"{name} is at its upper end: with {f0} held at {context.held(f0):g} no lobe is bright "
                f"enough; give the surface's own, --fix {f0}=VALUE (a metal's is near 1)."
            )


def _assumed_optics(context: Context) -> Iterator[str]:
    for name in context.specification.assumed:
        declared = context.solution.problem.declared(name)
        where = OPTICS[declared.role]
        yield f"{name} is taken as {context.held(name):g} {declared.unit}: {where} of the capture should say it."


def _little_geometry(context: Context) -> Iterator[str]:
    coverage = context.account.coverage
    if coverage < _COVERED:
        yield f"The geometry covers only {coverage:.0%} of the mask: check the camera and the mesh's units."


def _copied_channels(context: Context) -> Iterator[str]:
    if context.account.redundancy.channels:
        yield "The channels of every image are copies of each other: one is worked on, and reported."


def _idle_images(context: Context) -> Iterator[str]:
    for image, reason in context.account.redundancy.images.items():
        yield f"Image {image} ({context.account.names[image]}) is left out: {reason}."


def _twin_images(context: Context) -> Iterator[str]:
    names = context.account.names
    for image, twin in context.account.redundancy.contradictions.items():
        yield (
            f"Images {twin} ({names[twin]}) and {image} ({names[image]}) are the same pixels, stated to be "
            "under different lights or exposures: one of the files is not what it should be."
        )


def _odd_image(context: Context) -> Iterator[str]:
    bars = context.posterior.bars
    odd = None if bars.holds or bars.chi2 < _MISFIT else _without_one(context)
    if odd is not None:
        position, chi2 = odd
        image = context.account.images[position]
        yield (
            f"Without image {image} ({context.account.names[image]}) χ² per value would fall from {bars.chi2:.3g} to "
            f"{chi2:.2g}: check its light, its exposure and whether it shows the same object."
        )


def _empty_images(context: Context) -> Iterator[str]:
    account = context.account
    empty = [account.names[image] for image, count in zip(account.images, account.counts, strict=True) if not count]
    if empty:
        yield f"{', '.join(empty)} gives no usable pixel: is its light behind the object, or the image clipped?"


def _outliers(context: Context) -> Iterator[str]:
    share = context.solution.statistics.outliers
    if share > _MANY_OUTLIERS:
        yield (
            f"{share:.1%} of the values lie too far from the model to be noise and were left "
            "out: dust, highlights or shadows that model and geometry do not have?"
        )


def _poor_fit(context: Context) -> Iterator[str]:
    statistics = context.solution.statistics
    by_noise = context.posterior.bars.holds and statistics.outliers <= _SOME_OUTLIERS
    # Outliers are told by themselves.
    if statistics.relative_rmse_trimmed > _POOR and not by_noise:
        yield (
            f"The model misses the images by {statistics.relative_rmse_trimmed:.0%}: check encoding.transfer, the "
            "directions of the lights, and that normals have y up and z toward the viewer, or try another model."
        )


def _seen_together(context: Context) -> Iterator[str]:
    if names := context.lost_together:
        yield f"{' and '.join(names)} are not determined: these images see only a combination of them; fix one."


def _not_determined(context: Context) -> Iterator[str]:
    alone = [name for name in context.lost if name not in context.lost_together]
    if alone:
        told = [name + _channels(context.parameters[name]) for name in alone]
        yield f"{' and '.join(told)} {'are' if len(alone) > 1 else 'is'} not determined by these images."


def _lobes_not_seen(context: Context) -> Iterator[str]:
    if absent := context.posterior.lobes.amplitudes:
        yield f"No lobe of {' and '.join(sorted(absent))} is seen: intervals are of one as wide as fits best."


def _too_few_pixels(context: Context) -> Iterator[str]:
    bars = context.posterior.bars
    if not bars.holds and bars.kind == "fisher":
        yield "There are too few pixels for error bars that allow for the misfit of the model."


def _estimated_noise(context: Context) -> Iterator[str]:
    if context.account.noise:
        yield context.account.noise


def _imprecise(context: Context) -> Iterator[str]:
    """What could not be estimated to the precision asked for."""
    parameters, precision = context.parameters, context.precision
    errors = {
        name: max(abs(std / value) for value, std in _numbers(parameter) if value and std is not None)
        for name, parameter in parameters.items()
        if parameter.status == "determined" and any(value and std is not None for value, std in _numbers(parameter))
    }
    missed = [f"{name} ({error:.2g})" for name, error in errors.items() if precision is not None and error > precision]
    if missed:
        missed += [f"{name} (not at all)" for name, found in parameters.items() if found.status == "not determined"]
        yield f"All pixels together do not give the precision of {precision:g} that was asked for: {', '.join(missed)}."


# In the order in which they are told.
RULES: tuple[Callable[[Context], Iterator[str]], ...] = (
    _relative_radiometry,
    _held_by_default,
    _f0_too_low,
    _assumed_optics,
    _little_geometry,
    _copied_channels,
    _idle_images,
    _twin_images,
    _odd_image,
    _empty_images,
    _outliers,
    _poor_fit,
    _seen_together,
    _not_determined,
    _lobes_not_seen,
    _too_few_pixels,
    _estimated_noise,
    _imprecise,
)


def _numbers(parameter: ParameterEstimate) -> list[tuple[float | None, float | None]]:
    """Value and standard error of every channel."""
    value, std = parameter.value, parameter.std
    if isinstance(value, list) and isinstance(std, list):
        return list(zip(value, std, strict=True))
    return [(value, std)] if not isinstance(value, list) and not isinstance(std, list) else []


def _channels(parameter: ParameterEstimate) -> str:
    """Which channels of a parameter are not determined, where others are."""
    values = parameter.value if isinstance(parameter.value, list) else []
    lost = [str(channel) for channel, value in enumerate(values) if value is None]
    return f" of channel {', '.join(lost)}" if 0 < len(lost) < len(values) else ""


def _without_one(context: Context) -> tuple[int, float] | None:
    """The position of the one image without which the others are met far better, and χ² per value then; or None.

    Without it every other unknown moves by a Gauss-Newton step.
    """
    images = context.solution.statistics.regrouped(context.samples.groups.image)
    if len(images) < _FEW:
        return None
    total, slope = images.information, images.gradient
    costs, values = images.column("cost"), images.column("values")
    left = []
    for image in range(len(images)):
        information, gradient = total - images.only(image).information, slope - images.only(image).gradient
        everything = torch.ones(len(total), dtype=torch.bool)
        gain = float(gradient @ fisher(information, everything).matrix @ gradient)
        left.append(float(costs.sum() - costs[image] - gain) / max(float(values.sum() - values[image]), 1.0))
    best = min(range(len(left)), key=lambda image: left[image])
    chi2 = float(costs.sum()) / max(float(values.sum()), 1.0)
    return (int(images.labels[best]), left[best]) if left[best] < max(_MET, _SHARE * chi2) else None
