"""The facade: what photographs will tell of a model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from matest.capture import Capture
from matest.errors import InputError
from matest.estimation.options import Options, Value
from matest.estimation.specification import Specification, by_path, specify
from matest.identifiability.forecast import Forecast, as_estimated, bent_near, forecast, unknowns_at, usable
from matest.identifiability.next_light import NextLight, next_light, with_light
from matest.identifiability.plan import Plan, exposed
from matest.identifiability.reasons import Nearness, Reasons
from matest.inference.derived import known_by_derived, reported_name
from matest.inference.quantities import Number, ParameterEstimate
from matest.parameters import Domain
from matest.photographs.samples import PhotographSamples
from matest.progress import Progress, silent
from matest.shading import gathered_light, lit_directions

SCHEMA = "matest.check/1"
# What is checked of a capture when no model is named: the largest that `auto` tries.
DEFAULT_MODEL = "oren-nayar+cook-torrance"
# Shape parameters that nobody gave are also tried at these multiples of their default.
_LEVELS = (0.5, 2.0)
# A relative standard error above this is worth a word even where the parameter counts as determined.
_WEAK = 1.0


@dataclass(frozen=True)
class Prediction:
    """What the photographs will tell of one parameter. A list has one number per channel.

    Attributes:
        value: the value it is predicted for.
        std: predicted standard error; None where not determined, or not estimated.
        relative: largest std over value (over the domain's width where that is 0).
        range: smallest and largest `relative` over all levels of the shape parameters that were not given, None where
            one of them leaves it undetermined; None altogether where all do, or there was only one level.
        unit: "1", "rad", "µm".
        status: determined | weak (std above the value, or good near it only) | not determined | held (by default) |
            fixed | tied.
        reason: why it is weak, not determined, held, or known up to a scale only; empty otherwise.
    """

    value: Number
    std: Number
    relative: float | None
    range: tuple[float, float | None] | None
    unit: str
    status: str
    reason: str = ""


@dataclass(frozen=True)
class LightAdvice:
    """One more photograph that would lower the largest relative error bar most.

    Attributes:
        direction: unit vector to the light, world frame.
        from_camera: angle between it and the direction to the camera, radians.
        azimuth: angle about the direction to the camera, radians, from the image's right toward its top.
        irradiance: on a surface facing the light, [C].
        std: predicted standard errors with it, by parameter; None where still not determined.
        worst: largest relative standard error of a determined parameter before and after.
        gain: by how much the standard error of each parameter shrinks (2: half as large); None where it was or stays
            undetermined.
        resolves: parameters that become determined.
        frees: parameters that are held by default now, and that `estimate` frees with the light.
        freed: standard errors of all parameters then; empty where there are none such.
    """

    direction: tuple[float, float, float]
    from_camera: float
    azimuth: float
    irradiance: list[float]
    std: dict[str, Number]
    worst: tuple[float, float]
    gain: dict[str, float | None]
    resolves: list[str]
    frees: list[str]
    freed: dict[str, Number]


@dataclass(frozen=True)
class Check:
    """What some photographs will tell of a model.

    Attributes:
        capture: name of the capture.
        model: expression of the model.
        parameters: by name (in a sum: by path).
        light: the advice; None if no further light lowers any error bar.
        images: number of photographs.
        samples: usable pixels of all images together.
        skipped: pixels left out, by reason.
        noise: read, gain (fractions of full scale) and where they come from.
        highlight: smallest angle between half vector and normal of a usable sample, radians; None without samples.
        levels: for which values of the shape parameters `range` holds, by parameter.
        warnings: sentences.
    """

    capture: str
    model: str
    parameters: dict[str, Prediction]
    light: LightAdvice | None
    images: int
    samples: int
    skipped: dict[str, int]
    noise: dict[str, Any]
    highlight: float | None
    levels: dict[str, list[float]]
    warnings: list[str]

    def to_dict(self) -> dict[str, Any]:
        """The content of `matest check --json`."""
        return {"schema": SCHEMA, **asdict(self)}


def check(
    plan: Plan | Capture,
    model: str | None = None,
    *,
    fix: Mapping[str, Value] | None = None,
    free: Sequence[str] = (),
    tie: Mapping[str, str] | None = None,
    at: Mapping[str, Value] | None = None,
    noise: tuple[float, float] | None = None,
    progress: Progress = silent,
) -> Check:
    """Standard errors that `estimate` will report, predicted from geometry, lights, noise and values of the material.

    The Fisher information of noise-free photographs predicted for the values; their pixels are selected as those of
    real ones are: lit, off the rim, not clipped. Values not given are those of the scene's material or the model's
    defaults; shape parameters among the defaults are also halved and doubled together, for the `range`.

    Args:
        plan: of `load_plan`, or a capture; the pixels of its photographs serve for nothing but their noise.
        model: an expression; default: the scene's material, else "oren-nayar+cook-torrance".
        fix, free, tie: parameters, as for `estimate`.
        at: values that are assumed, by name or path; these are estimated all the same.
        noise: read and gain instead of the plan's: variance = read² + gain·signal, in fractions of full scale.
        progress: called with a word, and how much of it is done.

    Raises:
        InputError: unknown names, values outside their domains, impossible constraints, nothing left to estimate, a
            model that cannot be estimated under lights of unknown strength.
    """
    plan = Plan.of(plan) if isinstance(plan, Capture) else plan
    plan = plan if noise is None else plan.with_noise(*noise)
    return check_with(plan, Options(model=model, fix=fix or {}, free=free, tie=tie or {}), at or {}, progress)


def check_with(plan: Plan, options: Options, at: Mapping[str, Value], progress: Progress = silent) -> Check:
    """What `check` says of a plan, as options ask for it; values `at` are assumed.

    Raises:
        InputError: see `check`.
    """
    photographs, model = plan.photographs, options.model
    own = plan.material if plan.material is not None and model in (None, plan.material.expression) else None
    expression = own.expression if own is not None else model or DEFAULT_MODEL
    specification = specify(
        expression,
        options,
        channels=photographs.channels,
        relative=photographs.relative,
        scene=photographs.scene,
    )
    if not specification.problem.free:
        raise InputError(f"every parameter of {expression} is fixed or tied: there is no error to predict; free one.")
    fixed = by_path(specification.problem.brdf, options.fix)
    scene = {} if own is None else {name: value for name, value in own.parameters.items() if name not in fixed}
    given = scene | _by_ratio(specification, scene) | _assumed(specification, at)
    specification, values = _nominal(specification, given)

    progress("predicting photographs")
    photographs = photographs if plan.exposed else exposed(photographs, specification.problem.brdf.replace(values))
    problem = specification.problem
    samples = usable(photographs, problem, unknowns_at(problem, values))
    found, wider = as_estimated(samples, specification, values)
    nearness = _nearness(samples)
    levels = _levels(specification, values, given)
    spread = [found]
    for changed in levels:
        progress("trying other roughnesses")
        there = unknowns_at(found.problem, changed)
        spread.append(forecast(usable(photographs, found.problem, there), found.problem, there))
    advised, light = next_light(photographs, found, progress), None
    if advised is not None:
        after = advised.after
        if wider.problem.free != found.problem.free:
            after, _ = as_estimated(samples, specification, values, partial(with_light, photographs, light=advised))
        light = _advice(found, advised, after)
        if not light.resolves and light.worst[1] >= light.worst[0]:
            light = None
    relative = photographs.relative
    return Check(
        capture=plan.name,
        model=problem.brdf.replace(values).expression,
        parameters=_predictions(
            spread, Reasons(found, nearness, relative, bent_near(found, samples)), Reasons(wider, nearness, relative)
        ),
        light=light,
        images=len(photographs),
        samples=len(samples),
        skipped=samples.skipped,
        noise={"read": photographs.noise.read, "gain": photographs.noise.gain, "source": plan.noise_source},
        highlight=nearness.usable if math.isfinite(nearness.usable) else None,
        levels=_tried(found, levels, values),
        warnings=_warnings(plan, samples, own is not None, model is None),
    )


def _assumed(specification: Specification, at: Mapping[str, Value]) -> dict[str, Tensor]:
    """Values given for the prediction, by path."""
    problem, out = specification.problem, {}
    for path, value in by_path(problem.brdf, at, held=problem.held).items():
        if path in problem.ties or (path in problem.held and path not in specification.default_held):
            raise InputError(f"{path} is fixed or tied and not estimated; leave out its assumed value.")
        tensor = torch.as_tensor(value, dtype=torch.float64)
        if tensor.ndim > 1 or (tensor.ndim == 1 and len(tensor) != problem.count(path)):
            raise InputError(f"{path} takes {problem.count(path)} value(s); got {value}.")
        problem.brdf.replace({path: tensor.tolist()})  # checks the domain
        out[path] = tensor
    return out


def _nominal(specification: Specification, given: Mapping[str, Tensor]) -> tuple[Specification, dict[str, Tensor]]:
    """The values of every parameter that the prediction is made for; a parameter held by default is held at its own."""
    problem = specification.problem
    held = {name: given.get(name, value) if name in specification.default_held else value
            for name, value in problem.held.items()}  # fmt: skip
    values = {name: torch.as_tensor(value).double() for name, value in problem.brdf.parameters.items()}
    values |= {**given, **held}
    values |= {name: values[source] for name, source in problem.ties.items()}
    return replace(specification, problem=replace(problem, held=held)), values


def _levels(
    specification: Specification, values: Mapping[str, Tensor], given: Mapping[str, Tensor]
) -> list[dict[str, Tensor]]:
    """The values with all shape parameters that nobody gave scaled together, inside their domains."""
    problem = specification.problem
    open_shapes = [name for name in problem.shapes if name not in {*given, *problem.gauges}]
    out = []
    for level in _LEVELS if open_shapes else ():
        changed = {name: _inside(problem.declared(name).domain, level * values[name]) for name in open_shapes}
        scaled = {**values, **changed}
        out.append(scaled | {name: scaled[source] for name, source in problem.ties.items()})
    return out


def _inside(domain: Domain, value: Tensor) -> Tensor:
    return value.clamp(min=domain.lower, max=domain.upper)


def _tried(found: Forecast, levels: Sequence[Mapping[str, Tensor]], values: Mapping[str, Tensor]) -> dict[str, list]:
    """The values that the shape parameters took over the levels, ascending."""
    return {
        name: sorted({float(level[name]) for level in (values, *levels)})
        for name in found.problem.shapes
        if any(bool(level[name] != values[name]) for level in levels)
    }


def _nearness(samples: PhotographSamples) -> Nearness:
    """How near the samples come to the centre of a highlight."""
    scene, rim = samples.photographs.scene, samples.photographs.scene.surface.rim
    smallest = [math.inf, math.inf]
    for position, image in enumerate(samples.images):
        index = samples.indices(position)
        points = scene.points(image, dtype=torch.float64)
        if not points.wi.shape[-2]:
            continue
        reached = gathered_light(points).amax(-1) > 0
        angles = torch.where(reached, lit_directions(points).theta_half[..., 0], math.inf).amin(-1).numpy()
        # Several lights broadcast; one number per pixel all the same.
        angles = np.broadcast_to(angles, len(rim))
        smallest[0] = min(smallest[0], float(angles[index].min(initial=math.inf)))
        smallest[1] = min(smallest[1], float(angles.min(initial=math.inf)))
    return Nearness(*smallest)


def _by_ratio(specification: Specification, scene: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Lengths of a scene's material beside what the others are held at: only a derived quantity has an effect."""
    problem = specification.problem
    quantities = {name: problem.quantity(name) for name in scene if name in problem.where}
    return {
        name: quantity.inverse(quantity.value(scene), problem.held)
        for name, quantity in quantities.items()
        if quantity is not None
    }


def _predictions(spread: Sequence[Forecast], why: Reasons, why_held: Reasons) -> dict[str, Prediction]:
    """Every parameter of the model.

    Args:
        spread: the forecast, and those at the other levels.
        why: reasons by the parameters that are estimated.
        why_held: reasons by all, those held by default included.
    """
    out = {}
    found, problem = spread[0], spread[0].problem
    values = problem.values(found.unknowns)
    by_ratio = {reported_name(problem, name): name for name in problem.free if known_by_derived(problem, name)}
    for name, estimate in found.estimates().items():
        if name not in values and name not in by_ratio:
            continue
        source = problem.ties.get(name, by_ratio.get(name, name))
        status, std, relative, among, reason = estimate.status, estimate.std, None, None, ""
        if source in problem.where:
            place = problem.where[source]
            relative = float(found.relative_std[place].max())
            if len(spread) > 1:
                among = _among([float(level.relative_std[place].max()) for level in spread])
            lost = status == "not determined"
            status = "weak" if status == "determined" and relative > _WEAK else status
            reason = why.of(source) if status in ("weak", "not determined") else why.locked(source) or ""
            if status == "determined" and source in why.bent:
                status, reason = "weak", why.curved
            relative = None if lost else relative
            if known_by_derived(problem, name):
                among, reason = None, f"only {reported_name(problem, name)} is seen without coherent light"
        elif source in why_held.problem.where:
            status, reason = "held", why_held.of(source)
        value = estimate.value if name in by_ratio else values[name].tolist()
        out[name] = Prediction(value, std, relative, among, estimate.unit, status, reason)
    return out


def _among(relative: Sequence[float]) -> tuple[float, float | None] | None:
    smallest, largest = min(relative), max(relative)
    if not math.isfinite(smallest):
        return None
    return smallest, largest if math.isfinite(largest) else None


def _advice(before: Forecast, light: NextLight, estimated: Forecast) -> LightAdvice:
    """What a light brings, by the forecast before, and that of what `estimate` will free with it."""
    frees = [name for name in estimated.problem.free if name not in before.problem.free]
    estimates = estimated.estimates()
    labels = [reported_name(estimated.problem, name) for name in estimated.problem.free]
    then, now = before.estimates(), light.after.estimates()
    free = before.problem.free
    told = {name: reported_name(before.problem, name) for name in free}
    gain: dict[str, float | None] = {}
    for name in free:
        place = before.problem.where[name]
        ratio = float((before.std[place] / light.after.std[place]).max())
        known = math.isfinite(ratio) and not _lost(then[told[name]]) and not _lost(now[told[name]])
        gain[told[name]] = ratio if known else None
    return LightAdvice(
        direction=light.direction,
        from_camera=light.from_camera,
        azimuth=light.azimuth,
        irradiance=light.irradiance,
        std={name: now[name].std for name in told.values()},
        worst=(before.worst[1], light.after.worst[1]),
        gain=gain,
        resolves=[name for name in told.values() if _lost(then[name]) and not _lost(now[name])],
        frees=frees,
        freed={label: estimates[label].std for label in labels} if frees else {},
    )


def _lost(estimate: ParameterEstimate) -> bool:
    return estimate.status == "not determined"


def _warnings(plan: Plan, samples: PhotographSamples, own: bool, unnamed: bool) -> list[str]:
    out = []
    if unnamed and not own:
        out.append(f"No model was named: {DEFAULT_MODEL} is the largest that estimate tries; --model checks another.")
    if plan.photographs.relative:
        out.append("The strength of the lights is unknown (relative radiometry): albedos are known up to one scale.")
    if plan.material is not None and not own:
        out.append(f"The scene's material ({plan.material.expression}) is another model: its values are not used.")
    dark = [str(image) for image, count in zip(samples.images, samples.counts, strict=True) if not count]
    if dark:
        out.append(f"Image {', '.join(dark)} gives no usable pixel: its light is behind the object, or it is clipped.")
    clipped = samples.skipped["saturated"]
    if clipped:
        out.append(f"{clipped:,} pixels are predicted to be saturated: they tell little.")
    if plan.photographs.scene.surface.mesh is None:
        out.append("No mesh: cast shadows are unknown and left out of account.")
    return out
