"""Warnings of an estimate: a list of small rules, each with its own sentence."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from matest.estimation.brightness import impossible_brightness
from matest.estimation.odd_image import spoiling_image
from matest.estimation.photographs import PhotographFit, standing_out
from matest.estimation.specification import Specification
from matest.estimators import Solution
from matest.inference.derived import shows_only_in_derived
from matest.inference.posterior import Posterior
from matest.inference.quantities import ParameterEstimate, channel_names
from matest.parameters import OPTICS, Role
from matest.samples.account import Account, AccountedSamples
from matest.samples.uncertainty import labelled

# Share of the mask that the geometry should cover: less of it points to a wrong camera or wrong units of the mesh.
_MIN_COVERAGE = 0.5
# Relative rms error above which a mistake in the set-up is likelier than a model that is a little off.
_POOR_ERROR = 0.15
# Residuals in units of the noise from which on a model does not describe the samples, whoever looks at them; noise that
# was estimated a little low, and misfits that are seen only in it, make less.
_FAR_FROM_NOISE = 3.0
# Share of outliers above which noise alone does not explain a poor fit.
_OUTLIERS_BEYOND_NOISE = 0.001
# Share of outliers above which the user is told.
_MANY_OUTLIERS = 0.005
# Typical residual at some half angles, in standard deviations of the noise, above which a fifth of the values there
# would be outliers if the model held.
_MISSED_SCALE = 3.0
# Times that residuals at some half angles are as large as at others, if a lobe is likelier to be wrong than all of it.
_MISSED_RATIO = 3.0
# χ² per value above which one image is looked for that spoils the fit.
_SPOILT_CHI2 = 1.5
# Values for every unknown below which error bars are uncertain themselves: with more, by at most 1/√60 = 13 %.
_FEW_VALUES = 30


@dataclass(frozen=True)
class Context:
    """An estimate, as the rules read it.

    Attributes:
        samples: that were fitted.
        specification: what was to be estimated.
        solution, posterior: the result of the fit.
        precision: relative standard error that the user asked for; None: no such wish.
        first: what is to be said before all else: causes of residuals, and the choice of the model.
        explained: whether that says why the model does not hold.
        misread: whether it is since the capture is described wrongly.
        channels: names of the channels; empty: R, G, B, or numbers.
        images: how well each photograph is described.
        mapped: whether every pixel has a value of its own of a parameter.
    """

    samples: AccountedSamples
    specification: Specification
    solution: Solution
    posterior: Posterior
    precision: float | None
    first: Sequence[str] = ()
    explained: bool = False
    misread: bool = False
    channels: Sequence[str] = ()
    images: Sequence[PhotographFit] = ()
    mapped: bool = False

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
    def not_determined(self) -> list[str]:
        """Parameters that are not determined, except those that a derived quantity stands for."""
        names = [name for name, parameter in self.parameters.items() if parameter.status == "not determined"]
        return [name for name in names if not shows_only_in_derived(self.solution.problem, name)]

    @cached_property
    def seen_together(self) -> list[str]:
        """Those of them of which the samples see only a combination."""
        together = [name for name in self.not_determined if name in self.posterior.seen_together]
        return together if len(together) > 1 else []

    @cached_property
    def not_determined_alone(self) -> list[str]:
        """The rest of them."""
        return [name for name in self.not_determined if name not in self.seen_together]


# Says something of an estimate, or nothing.
Rule = Callable[[Context], Iterator[str]]


def warnings(context: Context, rules: Sequence[Rule] | None = None) -> list[str]:
    """The sentences of the rules that apply to an estimate; None: of all rules for photographs."""
    spoken = RULES if rules is None else rules
    if context.misread:
        # What else is odd follows from the mistake.
        spoken = [rule for rule in spoken if rule not in _SYMPTOMS]
    return [*context.first, *(warning for rule in spoken for warning in rule(context))]


def _not_described(context: Context) -> Iterator[str]:
    bars, subject = context.posterior.bars, context.account.subject
    times = math.sqrt(bars.chi2)
    if not context.explained and not bars.holds and times > _FAR_FROM_NOISE:
        yield (
            f"The model does not describe the {subject}: residuals are {times:.3g} times the noise. Try --model auto, "
            f"or check what is stated of these {subject}."
        )


def _relative_radiometry(context: Context) -> Iterator[str]:
    if context.samples.relative:
        yield "The common scale of the lights is unknown (relative radiometry): albedo is reported up to that scale."


def _held_by_default(context: Context) -> Iterator[str]:
    for name in context.specification.default_held:
        fresnel = context.solution.problem.declared(name).role is Role.FRESNEL
        beside = " beside the strength of the highlight" if fresnel else ""
        yield (
            f"{name} is held at {context.held(name):g}: these {context.account.subject} do not determine it{beside}; "
            f"--free {name} estimates it all the same, --fix {name}=VALUE sets it."
        )


def _f0_too_low(context: Context) -> Iterator[str]:
    """The model does not hold and an amplitude is at its upper end: the held `f0` keeps the lobe too dark."""
    problem = context.solution.problem
    held = context.specification.default_held
    # By the component of the sum that has it.
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


def _notes_of_readers(context: Context) -> Iterator[str]:
    yield from context.account.notes


def _little_geometry(context: Context) -> Iterator[str]:
    coverage = context.account.coverage
    if coverage < _MIN_COVERAGE:
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


def _odd_images(context: Context) -> Iterator[str]:
    """Of an image whose light explains what is odd this is said first, of another what leaving it out would bring."""
    bars = context.posterior.bars
    if [*standing_out(context.images)] or bars.holds or bars.chi2 < _SPOILT_CHI2:
        return
    if (odd := spoiling_image(context.solution.statistics, context.samples)) is not None:
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
        yield f"No usable pixel in {', '.join(empty)}: is the light behind the object, or the image clipped?"


def _outliers(context: Context) -> Iterator[str]:
    share = context.solution.statistics.outliers
    if share > _MANY_OUTLIERS:
        yield (
            f"{share:.1%} of the values lie too far from the model to be noise and were left "
            "out: dust, or shadows and edges that the geometry does not have?"
        )


def _missed_angles(context: Context) -> Iterator[str]:
    """A highlight that the model does not have is no set of outliers."""
    scale = context.solution.residual_scale
    if (angles := scale.above(max(_MISSED_SCALE, _MISSED_RATIO * scale.smallest))) is not None:
        start, end = (math.degrees(angle) for angle in angles)
        yield (
            f"Where the half vector is {start:.2g}° to {end:.2g}° off the normal, the model misses the "
            f"{context.account.subject} by up to {float(scale.values.max()):.2g} times the noise, elsewhere by as "
            f"little as {scale.smallest:.2g} times: it lacks what shows there. Those values count in full, not as "
            "outliers; try another lobe, or a second one."
        )


def _poor_fit(context: Context) -> Iterator[str]:
    statistics = context.solution.statistics
    by_noise = context.posterior.bars.holds and statistics.outliers <= _OUTLIERS_BEYOND_NOISE
    # Outliers have a warning of their own.
    if statistics.relative_rmse_trimmed > _POOR_ERROR and not by_noise and not context.explained:
        yield (
            f"The model misses the images by {statistics.relative_rmse_trimmed:.0%}: check encoding.transfer, the "
            "directions of the lights, their order and their axes (light_axes), and that normal maps have y up and z "
            "toward the viewer, or try another model."
        )


def _calibration_does_not_explain(context: Context) -> Iterator[str]:
    """Errors of the calibration were refined, and the misfit is not theirs: they bend to explain what they can."""
    names = [labelled(block.name) for block in context.solution.problem.nuisances]
    if names and not context.posterior.bars.holds and not context.explained:
        yield (
            f"The model does not hold with errors of {_listed(names)} refined either: what they and the "
            "parameters are may be wrong in a way that no error bar shows; look for another cause, or another model."
        )


def _seen_together(context: Context) -> Iterator[str]:
    if names := context.seen_together:
        yield (
            f"{_listed(names)} are not determined: these {context.account.subject} see only a combination of "
            "them; fix one."
        )


def _not_determined(context: Context) -> Iterator[str]:
    if names := context.not_determined_alone:
        labels = [name + _channels(context.parameters[name], context.channels) for name in names]
        verb = "are" if len(names) > 1 else "is"
        yield f"{_listed(labels)} {verb} not determined by these {context.account.subject}."


def _lobes_not_seen(context: Context) -> Iterator[str]:
    if absent := context.posterior.lobes.amplitudes:
        yield f"No lobe of {_listed(sorted(absent))} is seen: intervals are of one as wide as fits best."


def _too_few_pixels(context: Context) -> Iterator[str]:
    bars = context.posterior.bars
    if context.mapped and not bars.holds:
        yield "Beside a map error bars grow with the residuals alone: errors that images share are not in them."
    elif not bars.holds and bars.kind == "fisher":
        yield "There are too few pixels for error bars that allow for the misfit of the model."


def _averaged_slopes(context: Context) -> Iterator[str]:
    """Photographs average over the slopes of the surface within a pixel, which add up with those of the facets."""
    for name, parameter in context.parameters.items():
        declared = context.solution.problem.brdf.declared.get(name)
        if declared is None or declared.role is not Role.SLOPE or parameter.status != "determined":
            continue
        for value, std in _numbers(parameter):
            excess = 0.5 * context.account.slope_variance / value if value else 0.0
            if std and excess > std:
                yield (
                    f"{name} may be too large by {excess:.2g}, {excess / std:.3g} standard errors: a pixel of a "
                    "photograph averages over a part of the surface, and is shaded as its centre. Let the object fill "
                    "more pixels."
                )


def _few_values(context: Context) -> Iterator[str]:
    values, unknowns = int(context.solution.statistics.total("values")), len(context.solution.unknowns)
    if values < _FEW_VALUES * unknowns:
        yield (
            f"There are only {values} values for {unknowns} unknown{'s' * (unknowns != 1)}: error bars from so few are "
            "uncertain."
        )


def _stored_values(context: Context) -> Iterator[str]:
    """Where values pile up, how the noise was estimated, and how far apart codes are."""
    account = context.account
    yield from filter(None, (account.clipping, account.noise, account.codes))


def _imprecise(context: Context) -> Iterator[str]:
    """All samples together do not give the precision that the user asked for."""
    parameters, precision = context.parameters, context.precision
    errors = {
        name: max(abs(std / value) for value, std in _numbers(parameter) if value and std is not None)
        for name, parameter in parameters.items()
        if parameter.status == "determined" and any(value and std is not None for value, std in _numbers(parameter))
    }
    missed = [f"{name} ({error:.2g})" for name, error in errors.items() if precision is not None and error > precision]
    if missed:
        missed += [
            f"{name} (not at all)" for name, parameter in parameters.items() if parameter.status == "not determined"
        ]
        yield f"All pixels together do not give the precision of {precision:g} that was asked for: {', '.join(missed)}."


# In the order of the sentences.
RULES: tuple[Rule, ...] = (
    impossible_brightness,
    _not_described,
    _relative_radiometry,
    _held_by_default,
    _f0_too_low,
    _assumed_optics,
    _notes_of_readers,
    _little_geometry,
    _copied_channels,
    _idle_images,
    _twin_images,
    _odd_images,
    _empty_images,
    _outliers,
    _missed_angles,
    _poor_fit,
    _calibration_does_not_explain,
    _seen_together,
    _not_determined,
    _lobes_not_seen,
    _averaged_slopes,
    _too_few_pixels,
    _few_values,
    _stored_values,
    _imprecise,
)
# Of these the rules that tell of a misfit, whatever it is from.
_SYMPTOMS: tuple[Rule, ...] = (_not_described, _f0_too_low, _odd_images, _outliers, _missed_angles, _poor_fit)
# And those that hold for samples of any kind.
GENERAL_RULES: tuple[Rule, ...] = (
    impossible_brightness,
    _not_described,
    _relative_radiometry,
    _held_by_default,
    _f0_too_low,
    _notes_of_readers,
    _seen_together,
    _not_determined,
    _lobes_not_seen,
)


def _numbers(parameter: ParameterEstimate) -> list[tuple[float | None, float | None]]:
    """Value and standard error of every channel."""
    value, std = parameter.value, parameter.std
    if isinstance(value, list) and isinstance(std, list):
        return list(zip(value, std, strict=True))
    return [(value, std)] if not isinstance(value, list) and not isinstance(std, list) else []


def _channels(parameter: ParameterEstimate, names: Sequence[str]) -> str:
    """Words for the channels of a parameter that are not determined; empty if all are or none is."""
    values = parameter.value if isinstance(parameter.value, list) else []
    channels = [name for name, value in zip(names or channel_names(len(values)), values, strict=False) if value is None]
    return f" of channel {', '.join(channels)}" if 0 < len(channels) < len(values) else ""


def _listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last
