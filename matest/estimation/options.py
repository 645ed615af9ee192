"""What the user asks of an estimate or a check: the same words mean the same in every command and function."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from matest.errors import InputError, errors_of
from matest.samples.uncertainty import FOUND, NAMES, Uncertainty, families

Value = float | Sequence[float]
# The model name that asks `estimate` to choose the model.
AUTO = "auto"
# The same with every slope distribution tried, whether or not another one meets the images.
AUTO_ANY_DISTRIBUTION = "auto(distribution=any)"

# Largest radius of a filter, pixels: time grows with its square.
_WIDEST = 20
# Similarity to that name from which on a word is a slip for it: two letters exchanged have 0.75.
_SLIP = 0.75

# Most regions of maps: an object of more materials than that has as good as none.
_MOST_REGIONS = 50


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to estimate, and how. What does not depend on a capture is checked here.

    Attributes:
        model: an expression such as "oren-nayar+torrance-sparrow", "auto" or "auto(distribution=any)"; None: the user
            named none.
        fix: values of parameters that are not estimated, by name or path.
        free: parameters estimated although they are held by default.
        tie: dependent parameter -> the one whose value it takes.
        holdout: images to leave out of the fit.
        precision: relative standard error of every parameter that suffices, 0 to 1; None: read every pixel.
        seed: of the subsample that the search starts from.
        device: where tiles are evaluated ("cpu", "cuda").
        transfer: how pixels encode light: "linear", "srgb" or a gamma; None: as the capture says.
        uncertainty: of the calibration; what it states comes before what the capture states.
        refine: families of errors of the calibration to estimate with the material, names or one text that commas
            separate; becomes a tuple, "all" every family.
        maps: parameters with a value at every pixel; "albedo" is the body's, whatever the model calls it.
        regions: number of regions, found from the maps, whose values pixels take that do not tell their own; None: as
            many as their albedos stand apart in.
        smooth_maps: radius in pixels by which maps are smoothed too, beside the maps as they are; 0: not at all.

    Raises:
        InputError: a precision outside 0 to 1, another choice of `auto`, a slip in that name, an unknown family.
    """

    model: str | None = None
    fix: Mapping[str, Value] = field(default_factory=dict)
    free: Sequence[str] = ()
    tie: Mapping[str, str] = field(default_factory=dict)
    holdout: Sequence[int] = ()
    precision: float | None = None
    seed: int = 0
    device: str = "cpu"
    transfer: str | float | None = None
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    refine: Sequence[str] = ()
    maps: str | Sequence[str] = ()
    regions: int | None = None
    smooth_maps: int = 0

    def __post_init__(self) -> None:
        with errors_of("--refine"):
            object.__setattr__(self, "refine", families(self.refine))
        if isinstance(self.maps, str):
            object.__setattr__(self, "maps", tuple(name for name in map(str.strip, self.maps.split(",")) if name))
            if not self.maps:
                raise InputError("--maps names no parameter: name one, such as --maps albedo, or omit it.")
        if self.regions is not None and not 1 <= self.regions <= _MOST_REGIONS:
            raise InputError(f"--regions is a number of materials from 1 to {_MOST_REGIONS}; got {self.regions}.")
        if self.regions is not None and not self.maps:
            raise InputError(f"--regions {self.regions} says where maps share values: name the parameters with --maps.")
        if self.maps and (self.refine or self.precision):
            other = "--refine" if self.refine else "--precision"
            raise InputError(f"--maps and {other} do not go together: leave one of them out.")
        if not (isinstance(self.smooth_maps, int) and 0 <= self.smooth_maps <= _WIDEST):
            raise InputError(
                f"--smooth-maps is a radius in whole pixels up to {_WIDEST}, such as 3; got {self.smooth_maps}."
            )
        if self.smooth_maps and not self.maps:
            raise InputError("--smooth-maps smooths maps, and none is asked for: add --maps albedo.")
        if self.precision is not None and not 0 < self.precision < 1:
            raise InputError(
                f"precision is a relative standard error, such as 0.001, between 0 and 1; got {self.precision}."
            )
        # Names of models are told apart by their case; so is this one.
        if self.model is not None and not self.automatic and _reads_as_auto(self.model):
            raise InputError(f"--model {self.model}: unknown model; did you mean '{AUTO}'?")
        if self.model is not None and self.model.startswith(f"{AUTO}(") and self.model != AUTO_ANY_DISTRIBUTION:
            raise InputError(f"--model {self.model}: auto takes one choice only, {AUTO_ANY_DISTRIBUTION}.")
        if self.seed < 0:
            raise InputError(f"--seed must not be negative; got {self.seed}.")

    @property
    def refines_all(self) -> bool:
        """Whether every error of the calibration is to be estimated."""
        return {*NAMES} <= {*self.refine}

    @property
    def refines_found(self) -> bool:
        """Whether errors that explain residuals are to be estimated."""
        return FOUND in self.refine

    @property
    def automatic(self) -> bool:
        """Whether the estimate chooses the model."""
        return self.model in (None, AUTO, AUTO_ANY_DISTRIBUTION)

    def fitted_images(self, count: int) -> tuple[int, ...]:
        """Indices of the images, out of `count`, that the fit uses.

        Raises:
            InputError: an index that no image has, or every image held out.
        """
        for image in self.holdout:
            if not 0 <= image < count:
                raise InputError(f"holdout image {image}: the capture has images 0 to {count - 1}; correct --holdout.")
        images = tuple(image for image in range(count) if image not in self.holdout)
        if not images:
            raise InputError("every image is held out: leave at least one for the fit.")
        return images


def as_uncertainty(stated: Uncertainty | Mapping[str, Any] | None) -> Uncertainty:
    """What is stated of the calibration, as one type.

    Raises:
        InputError: no mapping, an unknown name, or a value that is refused.
    """
    if isinstance(stated, Uncertainty):
        return stated
    with errors_of("--uncertainty"):
        return Uncertainty.of({} if stated is None else stated)


def _reads_as_auto(expression: str) -> bool:
    """Whether an expression is the name `auto` but for its case or a letter."""
    name = expression.partition("(")[0].strip()
    return name != AUTO and bool(difflib.get_close_matches(name.lower(), [AUTO], cutoff=_SLIP))
