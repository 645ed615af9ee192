"""Why a parameter is not determined: from the weak directions of the information, and from the geometry."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from matest.brdf import Brdf, Sum
from matest.brdf.terms import Product
from matest.directions import Directions
from matest.errors import InputError
from matest.estimators import Problem
from matest.identifiability.forecast import Forecast
from matest.identifiability.highlight import Nearness
from matest.parameters import Role, options_of

# Relative standard error that stands for an infinite one, so that the covariance exists.
_LARGEST_RELATIVE_STD = 1e4
# Correlation with a parameter above which another one belongs to the combination that is not determined.
_MIN_CORRELATION = 0.5
# Relative standard error at given other parameters above which the samples barely show a parameter.
_BARELY_SHOWN = 0.1
# The same, above which they do not show it: no change inside its domain would stand out of the noise.
_NOT_SHOWN = 1e3
# Distance of an exponent from ±1 up to which a combination is called a ratio or a product.
_EXPONENT_TOLERANCE = 0.15
# A shape is a lobe if it is this many times as high in the mirror direction as 40 degrees off it.
_LOBE_CONTRAST = 5.0


@dataclass(frozen=True, eq=False)
class Reasons:
    """Sentences on why the samples of a forecast determine a parameter badly or not at all.

    Attributes:
        forecast: the parameters asked about are free in it.
        nearness: of its samples to a highlight.
        relative: whether the strength of the lights is unknown.
        bent: names of parameters along a valley of the likelihood that bends within their standard errors.
    """

    forecast: Forecast
    nearness: Nearness
    relative: bool
    bent: tuple[str, ...] = ()

    @property
    def problem(self) -> Problem:
        return self.forecast.problem

    def of(self, name: str) -> str:
        """Why `name` is not determined, or badly."""
        if not self.forecast.values:
            return "no image has a usable sample"
        if absent := self._absent(name):
            return absent
        # A parameter with a small error at given other parameters shows: then these are the reason, not the highlight.
        if self._alone(name) > _BARELY_SHOWN and (out_of_sight := self._out_of_sight(name)):
            return out_of_sight
        others = self._partners(name)
        if not others and self._alone(name) < _BARELY_SHOWN:
            return f"{name} is seen only in combination with the other parameters"
        if not others:
            return self._effect(name)
        if len(others) == 1:
            return self._pair(name, *next(iter(others.items())))
        *most, last = [name, *others]
        return f"{', '.join(most)} and {last} are seen only in combination"

    @property
    def curved(self) -> str:
        """That the errors of the parameters along a bent valley are right to first order only."""
        return f"errors of {' and '.join(self.bent)} hold only very near the values assumed"

    def locked(self, name: str) -> str | None:
        """That a parameter carries the unknown scale of the light; None if it does not."""
        scales = self.problem.declared(name).per_channel and math.isinf(self.problem.domain(name).upper)
        if self.relative and scales:
            return f"{name} and the light scale are locked: it is known up to that scale"
        return None

    def _absent(self, name: str) -> str | None:
        """That every term with the parameter vanishes at these values."""
        values, products = self.forecast.expansion.values, self._products(name)
        zero = [{f.name for f in product if not bool(f.value(values).any())} - {name} for product in products]
        if products and all(zero):
            return f"what it shapes is absent: {min(zero[0])} is 0 at the values assumed"
        return None

    def _out_of_sight(self, name: str) -> str | None:
        """That no sample comes near the highlight that the parameter belongs to."""
        width = max((self._half_width(product) for product in self._products(name)), default=math.inf)
        if self.nearness.usable <= width:
            return None
        degrees = math.degrees(self.nearness.usable)
        distance = f"{degrees:.0f}°" if degrees >= 3 else f"{degrees:.1f}°"
        if self.nearness.lit <= width:
            return f"every sample within {distance} of the highlight is clipped or at an edge: add a shorter exposure"
        return f"no image samples within {distance} of the highlight"

    def _products(self, name: str) -> list[Product]:
        """The factors of the terms that depend on a parameter."""
        structure, ties = self.problem.brdf.structure, self.problem.ties
        names = {name, *(dependent for dependent, source in ties.items() if source == name)}
        multiplied = [product for product in structure.products if names & {factor.name for factor in product}]
        shaped = [product for one in names for product in structure.carriers(one)]
        return list(dict.fromkeys([*multiplied, *shaped]))

    def _half_width(self, product: Product) -> float:
        """Half angle at which a lobe has fallen to 1/e of its height, 30° from the normal; infinite if it is none."""
        angles = torch.deg2rad(torch.arange(0.0, 40.5, 0.25, dtype=torch.float64))
        tilt = math.pi / 6
        # Out of the plane of incidence, so that the light stays above the horizon as the half vector turns.
        viewer = torch.tensor([math.sin(tilt), 0.0, math.cos(tilt)], dtype=torch.float64)
        half = torch.stack([torch.zeros_like(angles), angles.sin(), angles.cos()], dim=-1)
        light = 2 * (half @ viewer)[:, None] * half - viewer
        directions = Directions(light, viewer.expand_as(light))
        terms = self.problem.material(self.forecast.unknowns).terms(directions)
        heights = sum(term.shape.expand(len(angles), -1).amax(-1) for term in terms if term.factors == product)
        heights = torch.as_tensor(heights)
        if not bool(heights[0] > _LOBE_CONTRAST * heights[-1].abs()):
            return math.inf
        return float(angles[int((heights > heights[0] / math.e).nonzero().max())])

    @cached_property
    def _covariance(self) -> Tensor:
        """Covariance relative to the values; directions without information get a large but finite error."""
        scale = self.forecast.references
        information = self.forecast.information * scale[:, None] * scale[None, :]
        return torch.linalg.inv(information + torch.eye(len(scale)).double() / _LARGEST_RELATIVE_STD**2)

    def _partners(self, name: str) -> dict[str, float]:
        """Relative changes of other parameters that best hide a relative change of `name` by 1 from the images.

        Only of the parameters that are correlated with it.
        """
        problem, covariance = self.problem, self._covariance
        place = problem.where[name]
        worst = place.start + int(covariance.diagonal()[place].argmax())
        moves = covariance[:, worst] / covariance[worst, worst]
        correlation = moves.abs() * (covariance[worst, worst] / covariance.diagonal()).sqrt()
        return {
            other: float(moves[span][correlation[span].argmax()])
            for other, span in problem.where.items()
            if other != name and bool(correlation[span].max() > _MIN_CORRELATION)
        }

    def _pair(self, name: str, other: str, move: float) -> str:
        """What the images show of two parameters; `move` is the exponent with which the other follows `name`."""
        if abs(move + 1) < _EXPONENT_TOLERANCE:
            return f"{name} and {other} appear only as a product here"
        if abs(move - 1) < _EXPONENT_TOLERANCE:
            numerator, denominator = sorted((name, other), key=list(self.problem.brdf.declared).index)
            remedy = self._separating(name, other)
            return f"only {numerator}/{denominator} is determined" + (f" without {remedy}" if remedy else " here")
        return f"{name} and {other} are seen only in combination"

    def _separating(self, name: str, other: str) -> str | None:
        """The option with which a model would show more of two parameters than their ratio."""
        brdf = self.problem.brdf
        (component, _, key), (others_component, _, others_key) = name.rpartition("."), other.rpartition(".")
        parts = {part.name: part for part in brdf.components} if isinstance(brdf, Sum) else {"": brdf}
        part = parts[component]
        if others_component != component or not _only_derived(part, key, others_key):
            return None
        for option, choices in options_of(type(part)).items():
            for choice in choices:
                try:
                    variant = replace(part, **{option: choice})  # type: ignore[type-var]
                except InputError:
                    continue
                if {key, others_key} <= {*variant.declared} and not _only_derived(variant, key, others_key):
                    doc = type(part).__dataclass_fields__[option].metadata["doc"]  # type: ignore[attr-defined]
                    return f"{option}={choice} ({doc.partition(' (')[0]})"
        return None

    def _alone(self, name: str) -> float:
        """Relative standard error of a parameter at given other parameters."""
        place = self.problem.where[name]
        information = self.forecast.information.diagonal()[place].clamp(min=0)
        return float((information.rsqrt() / self.forecast.references[place]).max())

    def _effect(self, name: str) -> str:
        """How large a change of a parameter would stand out of the noise."""
        needed = self._alone(name)
        if needed > _NOT_SHOWN:
            return f"these images do not change with {name} at the values assumed"
        return f"these images hardly change with {name}: only by {needed:.0%} of itself would it stand out of the noise"


def _only_derived(brdf: Brdf, name: str, other: str) -> bool:
    """Whether two parameters have an effect only through a quantity derived from them."""
    roles = {brdf.declared[key].role for key in (name, other)}
    return Role.YARDSTICK in roles and any({name, other} <= {*names} for names in brdf.structure.derived.values())
