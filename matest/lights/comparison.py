"""Lights that were found beside another list of them: how far apart, and whether the order agrees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matest.errors import InputError
from matest.lights.lights import Lights


@dataclass(frozen=True)
class ListedLights:
    """Directions of lights from a file.

    Attributes:
        file: that states them.
        names: of the photographs; None: the file names none.
        directions: unit vectors to the lights [K, 3].
    """

    file: Path
    names: tuple[str, ...] | None
    directions: np.ndarray


@dataclass(frozen=True)
class Comparison:
    """How far lights are from a list of them.

    Attributes:
        listed: the list.
        by_name: whether lights were paired by the names of photographs; otherwise by their order.
        directions: of the list, in the order of the photographs [K, 3].
        angles: between found and listed directions, rad [K].
        order: place in `directions` of the light that each photograph fits in the best order of all; where no other
            order fits better it counts up from 0 [K].
        reordered: the angles in that order, rad [K].
    """

    listed: ListedLights
    by_name: bool
    directions: np.ndarray
    angles: np.ndarray
    order: np.ndarray
    reordered: np.ndarray

    @property
    def moved(self) -> np.ndarray:
        """Photographs that another light of the list fits better [n]."""
        return np.flatnonzero(self.order != np.arange(len(self.order)))


def compare(lights: Lights, listed: ListedLights) -> Comparison:
    """Lights beside a list of them, paired by the names of photographs where both have the same, else by their order.

    Raises:
        InputError: another number of lights.
    """
    from scipy.optimize import linear_sum_assignment

    names = [light.name for light in lights.lights]
    if len(names) != len(listed.directions):
        raise InputError(
            f"{listed.file}: expected {len(names)} lights, as there are photographs of the mirror sphere; got "
            f"{len(listed.directions)}. Give the list of the same lights."
        )
    by_name = listed.names is not None and sorted(listed.names) == sorted(names)
    places: Sequence[int] = (
        [listed.names.index(name) for name in names] if by_name and listed.names else [*range(len(names))]
    )
    directions = listed.directions[places]
    between = _angles(np.stack([light.direction for light in lights.lights]), directions)
    # Squares: one light that is far off counts more than several that are a little.
    order = linear_sum_assignment(between**2)[1]
    return Comparison(
        listed, by_name, directions, np.diag(between), order, between[np.arange(len(order)), order]
    )  # fmt: skip


def _angles(some: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Angles between all pairs of unit vectors, rad [n, m]; by the chord, which keeps the digits of small ones."""
    chords = np.linalg.norm(some[:, None] - others[None], axis=2)
    angles: np.ndarray = 2 * np.arcsin(np.clip(chords / 2, 0, 1))
    return angles
