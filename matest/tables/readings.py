"""Which reading of a CSV table its values support: units of angles, side of the azimuth, quantity.

Nothing is guessed: where two readings fit alike, the table is refused until one is declared.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from matest.errors import InputError
from matest.tables.declaration import Azimuth, Declaration, Quantity, Unit

# Degrees. No polar angle and no azimuth in radians is larger, rounding included.
_LARGEST_POLAR = 1.6
_LARGEST_AZIMUTH = 6.4
# Radians from the normal from which on a light tells the two sides of the azimuth apart.
_OBLIQUE = math.radians(20)
# Radians between half vector and normal: of the values in a highlight, and of those beside it.
_IN_HIGHLIGHT = math.radians(8)
_BESIDE_HIGHLIGHT = (math.radians(20), math.radians(40))
# A highlight is so many times as bright as what lies beside it; rough matte surfaces toward the light are not.
_HIGHLIGHT = 2.5
# On the other side nothing may be as much brighter as this.
_NO_HIGHLIGHT = 1.5
# Radians between a pair of directions and the exchanged pair, for the two to be compared.
_SAME_PAIR = math.radians(2)
# Radians by which polar angles of light and viewer must differ, for an exchange to say anything.
_DIFFERENT = math.radians(5)
# Exchanged pairs that are enough to judge by.
_MIN_PAIRS = 8
# Rings and sectors of equal solid angle that the hemisphere of viewers is divided into.
_CELLS = (6, 12)
# Share of these cells that must have a value, for the reflected light to be summed.
_MIN_COVERAGE = 0.7
# A surface reflects at most all light; the sum over cells is that wrong where a highlight is sharp.
_TOO_BRIGHT = 1.3
# A reading fits if its exchanged pairs differ so many times less than those of the other.
_CLEARLY = 1.5
# What is to be done about a declaration that the values contradict.
_CHECK = "check what is declared; it was followed."


def in_radians(angles: np.ndarray, declared: Unit | None) -> tuple[Unit, np.ndarray]:
    """Unit of angles θi, φi, θr, φr [n, 4], and the angles in radians.

    Raises:
        InputError: neither unit gives such angles.
    """
    polar, azimuth = np.abs(angles[:, ::2]).max(), np.abs(angles[:, 1::2]).max()
    if declared is None and polar <= _LARGEST_POLAR < _LARGEST_AZIMUTH < azimuth:
        raise InputError(
            f"polar angles reach {polar:.3g} and azimuths {azimuth:.3g}, as if in different units; declare --units rad "
            "or deg (or convert the angles)."
        )
    units: Unit = declared or ("rad" if polar <= _LARGEST_POLAR else "deg")
    return units, angles.copy() if units == "rad" else np.radians(angles)


def other_unit(angles: np.ndarray, declared: Unit | None) -> str:
    """A clause that says so where angles θi, φi, θr, φr [n, 4] clearly have another unit than is declared, or none."""
    polar, azimuths = np.abs(angles[:, ::2]).max(), np.abs(angles[:, 1::2]).max()
    if declared == "deg" and polar <= _LARGEST_POLAR and azimuths <= _LARGEST_AZIMUTH:
        return f"Declared are degrees, but polar angles reach {polar:.3g} only, as if in radians"
    if declared == "rad" and polar > math.pi:
        return f"Declared are radians, but polar angles reach {polar:.3g}, as if in degrees"
    return ""


def azimuth(angles: np.ndarray, values: np.ndarray) -> Azimuth:
    """Where light and viewer have the same azimuth, by the side that the highlight lies on.

    A highlight is sharp and brighter at oblique incidence; what is bright toward the light is broad, or darker there.

    Args:
        angles: θi, φi, θr, φr in radians [n, 4].
        values: [n, C].

    Raises:
        InputError: no highlight, or one on both sides.
    """
    side = _highlighted_side(angles, values)
    if side is None:
        raise InputError(
            "no highlight tells whether phi_r = phi_i is the side of the light or the mirror's: both readings fit "
            "alike; declare --azimuth retro or forward."
        )
    return side


def _highlighted_side(angles: np.ndarray, values: np.ndarray) -> Azimuth | None:
    """The reading under which the highlight is one; None: neither, or both."""
    retro, forward = (_highlight(angles, values.mean(1), offset) for offset in (0.0, math.pi))
    if retro > _HIGHLIGHT and forward < _NO_HIGHLIGHT:
        return "retro"
    if forward > _HIGHLIGHT and retro < _NO_HIGHLIGHT:
        return "forward"
    return None


def _highlight(angles: np.ndarray, values: np.ndarray, offset: float) -> float:
    """How much brighter a table is near the mirror direction than beside it; 0 where it is not a highlight.

    The azimuth of the light counts with this offset.
    """
    theta_i, phi_i, theta_r, phi_r = angles.T
    # Slope of the half vector.
    x = np.sin(theta_i) + np.sin(theta_r) * np.cos(phi_r - phi_i - offset)
    y = np.sin(theta_r) * np.sin(phi_r - phi_i - offset)
    tilt = np.arctan2(np.hypot(x, y), np.cos(theta_i) + np.cos(theta_r))
    inside, beside = tilt < _IN_HIGHLIGHT, (tilt > _BESIDE_HIGHLIGHT[0]) & (tilt < _BESIDE_HIGHLIGHT[1])
    contrasts, peaks = [], []
    for incidence in np.unique(theta_i[theta_i > _OBLIQUE].round(2)):
        here = np.abs(theta_i - incidence) < 0.01
        if (here & inside).any() and (here & beside).any():
            peaks.append(values[here & inside].max())
            contrasts.append(peaks[-1] / max(float(np.median(values[here & beside])), 1e-12))
    if not contrasts or peaks[-1] < peaks[0]:
        return 0.0
    return float(np.median(contrasts))


def quantity(angles: np.ndarray, values: np.ndarray) -> Quantity:
    """What the values are, by reciprocity and by the light that they reflect.

    f and π f are told apart only where f would reflect more light than there is.

    Args:
        angles: θi, φi, θr, φr in radians [n, 4].
        values: [n, C].

    Raises:
        InputError: two readings fit alike.
    """
    evidence = _Evidence.of(angles, values)
    if len(evidence.supported) > 1:
        raise InputError(evidence.doubt)
    return evidence.supported[0]


@dataclass(frozen=True)
class _Evidence:
    """What values say of the quantity that they are.

    Attributes:
        f, f_cos: typical relative difference of exchanged directions if they are f, or f cos θi; None: too few pairs.
        albedo: largest share of the light that they reflect if they are f; None: viewers cover too little.
    """

    f: float | None
    f_cos: float | None
    albedo: float | None

    @classmethod
    def of(cls, angles: np.ndarray, values: np.ndarray) -> _Evidence:
        """That of θi, φi, θr, φr in radians [n, 4] and values [n, C]."""
        mean = values.mean(1)
        f, f_cos = (_asymmetry(angles, mean / share) for share in (1.0, np.cos(angles[:, 0]).clip(1e-3)))
        return cls(f, f_cos, _albedo(angles, mean))

    @property
    def supported(self) -> tuple[Quantity, ...]:
        """The quantities that the values may be."""
        if self.f is None or self.f_cos is None:
            return "f", "pi-f", "f-cos"
        if _CLEARLY * self.f_cos < self.f:
            return ("f-cos",)
        if not _CLEARLY * self.f < self.f_cos:
            return "f", "pi-f", "f-cos"
        return ("pi-f",) if self.albedo is not None and self.albedo > _TOO_BRIGHT else ("f", "pi-f")

    @property
    def doubt(self) -> str:
        """Why several quantities are possible."""
        if self.f is None or self.f_cos is None:
            return (
                "the table has too few pairs of exchanged directions to tell f from f cos θi by reciprocity; declare "
                "--quantity f, pi-f or f-cos."
            )
        if "f-cos" in self.supported:
            return (
                f"f and f cos θi fit alike: exchanged directions differ by {self.f:.0%} and {self.f_cos:.0%}; declare "
                "--quantity f, pi-f or f-cos."
            )
        if self.albedo is None:
            return (
                "f and π f fit alike: viewers cover too little of the hemisphere to sum the reflected light; declare "
                "--quantity f or pi-f."
            )
        return (
            f"f and π f fit alike: the surface would reflect {self.albedo:.0%} or {self.albedo / math.pi:.0%} of the "
            "light; declare --quantity f or pi-f."
        )


def doubts(stated: np.ndarray, angles: np.ndarray, values: np.ndarray, declaration: Declaration) -> Iterator[str]:
    """Sentences on what is declared and the values clearly contradict.

    Args:
        stated: θi, φi, θr, φr in the unit that is declared [m, 4].
        angles: those of the rows above the horizon, in radians [n, 4].
        values: of these [n, C].
        declaration: how they are read.
    """
    if odd := other_unit(stated, declaration.units):
        yield f"{odd}: {_CHECK}"
    side = _highlighted_side(angles, values) if declaration.azimuth else None
    if side not in (None, declaration.azimuth):
        yield f"Declared is azimuth {declaration.azimuth}, but the highlight lies where {side} has it: {_CHECK}"
    supported = _Evidence.of(angles, values).supported if declaration.quantity else ()
    if supported and declaration.quantity not in supported:
        why = "it would reflect more light than there is" if supported == ("pi-f",) else "exchanged directions differ"
        named = " or ".join(supported)
        yield f"Declared is quantity {declaration.quantity}, but {why} unless it is {named}: {_CHECK}"


def _asymmetry(angles: np.ndarray, values: np.ndarray) -> float | None:
    """Typical relative difference between values at exchanged directions; None: too few are there."""
    from scipy.spatial import cKDTree

    theta_i, phi_i, theta_r, phi_r = angles.T
    between = np.abs((phi_r - phi_i + math.pi) % (2 * math.pi) - math.pi)
    place = np.stack([theta_i, theta_r, between * np.sin(np.minimum(theta_i, theta_r))], axis=1)
    distance, partner = cKDTree(place).query(place[:, [1, 0, 2]], distance_upper_bound=_SAME_PAIR)
    rows = np.flatnonzero(np.isfinite(distance) & (np.abs(theta_i - theta_r) > _DIFFERENT))
    a, b = values[rows], values[partner[rows]]
    usable = a + b > 0
    if usable.sum() < _MIN_PAIRS:
        return None
    return float(np.median(np.abs(a - b)[usable] / (a + b)[usable])) * 2


def _albedo(angles: np.ndarray, values: np.ndarray) -> float | None:
    """The largest share of the light that values f would reflect, over incidences with viewers all around.

    Values are averaged over cells of equal solid angle first: many lie near a highlight. None: no such incidence.
    """
    theta_i, phi_i, theta_r, phi_r = angles.T
    rings, sectors = _CELLS
    ring = (np.cos(theta_r) * rings).astype(int).clip(0, rings - 1)
    sector = ((phi_r - phi_i) % (2 * math.pi) / (2 * math.pi) * sectors).astype(int) % sectors
    cell, shares = ring * sectors + sector, list[float]()
    for incidence in np.unique(theta_i.round(2)):
        here = theta_i.round(2) == incidence
        counts, sums = (np.bincount(cell[here], weights, rings * sectors) for weights in (None, values[here]))
        seen = counts > 0
        if seen.mean() > _MIN_COVERAGE:
            # The mean cosine of each ring.
            cosine = ((np.arange(rings * sectors) // sectors + 0.5) / rings)[seen]
            shares.append(math.pi * float((cosine * sums[seen] / counts[seen]).sum() / cosine.sum()))
    return max(shares, default=None)


def as_reflectance(angles: np.ndarray, values: np.ndarray, quantity: Quantity) -> np.ndarray:
    """f in 1/sr [n, C] from values that are such a quantity."""
    if quantity == "f-cos":
        return values / np.cos(angles[:, :1])
    return values / math.pi if quantity == "pi-f" else values
