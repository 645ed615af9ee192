"""What samples tell of where they come from: names, counts, and what was left out of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

from matest.samples.batch import Batch
from matest.samples.calibration import Calibration
from matest.samples.reading import Reading
from matest.samples.redundancy import Redundancy
from matest.samples.source import Samples
from matest.samples.texels import TexelTile, TexelTileGroups


@dataclass(frozen=True)
class Account:
    """Where samples come from, for people to read.

    Attributes:
        names: of all images that there are.
        notes: what was done to the values that are stored in files, as sentences.
        images: number, among these, of each image that the samples are of.
        counts: usable samples of each of them.
        skipped: values left out, by reason.
        redundancy: images and channels that add nothing to the others.
        pixels: of one image, background included.
        coverage: share of the mask that the geometry covers.
        one_light_each: whether every image has one light, and no sky.
        slope_variance: of the surface within a pixel, its two directions together; 0 where it is not known.
        geometry: what did not have to be computed of light and shape, as clauses.
        noise: how the noise was estimated, as a sentence; empty where it is stated.
        codes: how far apart stored codes are, as a sentence; empty where they are neighbouring integers.
        clipping: where values pile up below the stated saturation, as a sentence; empty where they do not.
        subject: what the samples are, in the plural.
    """

    names: Sequence[str] = ()
    notes: Sequence[str] = ()
    images: Sequence[int] = ()
    counts: Sequence[int] = ()
    skipped: dict[str, int] = field(default_factory=dict)
    redundancy: Redundancy = field(default_factory=Redundancy)
    pixels: int = 0
    coverage: float = 1.0
    one_light_each: bool = False
    slope_variance: float = 0.0
    geometry: Sequence[str] = ()
    noise: str = ""
    codes: str = ""
    clipping: str = ""
    subject: str = "images"


class AccountedSamples(Samples, Protocol):
    """Samples that give an account of themselves: an estimate tells people of it."""

    @property
    def account(self) -> Account: ...


class CalibratedSamples(AccountedSamples, Protocol):
    """Samples whose calibration may have errors.

    Attributes:
        calibration_names: of the kinds of errors that have an effect on them.
        texels: N, the number of pixels of the object.
        directions: of light that a sample is shaded under, at most.
    """

    @property
    def calibration_names(self) -> Sequence[str]: ...

    @property
    def texels(self) -> int: ...

    @property
    def directions(self) -> int: ...

    def texel_tiles(self) -> TexelTileGroups:
        """All samples, texel by texel."""

    def some_texels(self, count: int, seed: int) -> TexelTile:
        """All samples at about `count` random texels."""

    def calibration(self, names: Sequence[str]) -> Calibration:
        """The errors of some kinds, in the order of their unknowns, and what they do to the samples."""

    def of_pixels(self, count: int, seed: int) -> tuple[Batch, float]:
        """All samples at about `count` random pixels of the object, and by how much there are more of them."""

    def better_readings(self) -> Sequence[Reading]:
        """What may have been meant where it explains them far better than what is stated; all that are equally good."""
