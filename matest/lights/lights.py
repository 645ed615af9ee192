"""Lights from what one or several mirror spheres show of them: directions, positions, and how far to trust them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matest.errors import InputError
from matest.lights.directions import Sighting
from matest.lights.extent import Extent, combine, common_extent
from matest.lights.mirror import Mirror
from matest.lights.position import Placement, Position, intersect
from matest.progress import Progress, silent

# How many times as far apart as their errors say spheres see lights before it is said.
_DISAGREE = 2.0


@dataclass(frozen=True)
class Light:
    """The light of one photograph.

    Attributes:
        name: of the photograph.
        direction: unit vector to the light in world coordinates [3].
        own: covariance of the direction that no other light shares [3, 3].
        common: changes of the direction with one standard error of each number that all lights share [n, 3].
        sightings: of every sphere.
        apart: largest angle between what two spheres see, rad; None of one sphere.
        position: in world units, where two spheres determine it.
        extent: its solid angle; None where no highlight tells it.
    """

    name: str
    direction: np.ndarray
    own: np.ndarray
    common: np.ndarray
    sightings: tuple[Sighting, ...]
    apart: float | None = None
    position: Position | None = None
    extent: Extent | None = None

    @property
    def std(self) -> float:
        """Standard error of each of two tangential angles of the direction, rad."""
        return float(np.sqrt((np.trace(self.own) + (self.common**2).sum()) / 2))


@dataclass(frozen=True)
class Lights:
    """The lights of all photographs.

    Attributes:
        lights: one for each photograph.
        excess: standard deviation of each tangential angle by which spheres disagree beyond their errors, rad.
        notes: sentences that a user should read.
    """

    lights: tuple[Light, ...]
    excess: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def extents(self) -> list[Extent | None]:
        """Solid angles as files state them: one for all lights where every one is told and they agree."""
        extents = [light.extent for light in self.lights]
        shared = common_extent(extents)
        return extents if shared is None else [shared] * len(extents)

    @property
    def uncertainty(self) -> dict[str, float]:
        """Standard deviations in rad by the names of `samples.uncertainty`.

        `direction`: of each tangential angle of each light; `rotation`: of the angles of a rotation of all of them,
        which is what an error of a sphere's centre does.
        """
        directions = np.stack([light.direction for light in self.lights])
        variance = float(np.mean([np.trace(light.own) for light in self.lights])) / 2
        changes = np.stack([light.common for light in self.lights], axis=1)
        if len(directions) < 2:
            return {"direction": float(np.sqrt(variance + (changes**2).sum() / 2))}
        # ω × l for each light l: a row of the matrix is how one coordinate of one light moves with ω.
        turns = np.cross(np.eye(3)[None], directions[:, None]).transpose(0, 2, 1).reshape(-1, 3)
        rotations = np.linalg.lstsq(turns, changes.reshape(len(changes), -1).T, rcond=None)[0]
        rest = changes.reshape(len(changes), -1).T - turns @ rotations
        direction = np.sqrt(variance + (rest**2).sum() / (2 * len(directions)))
        return {"direction": float(direction), "rotation": float(np.sqrt((rotations**2).sum() / 2))}


def find_lights(mirrors: Sequence[Mirror], placement: Placement | None = None, progress: Progress = silent) -> Lights:
    """The lights that mirror spheres show.

    Args:
        mirrors: photographs of spheres, in each capture one for each light, in the same order.
        placement: of the spheres in the world, from which positions of near lights follow; None: directions only.
        progress: called with a word, the number of images read and their total.

    Raises:
        InputError: captures of different lengths, or a highlight that cannot be told from the rest.
    """
    first = mirrors[0]
    for mirror in mirrors[1:]:
        if len(mirror.files) != len(first.files):
            raise InputError(
                f"{mirror.folder}: expected as many photographs as in {first.folder}, {len(first.files)}, one for each "
                f"light; got {len(mirror.files)}."
            )
    spheres = [sphere for mirror in mirrors for sphere in mirror.spheres]
    seen = [sightings for mirror in mirrors for sightings in mirror.sightings(progress)]
    by_light = list(zip(*seen, strict=True))
    excess = _excess(by_light) if len(seen) > 1 and placement is None else 0.0
    lights = tuple(
        _light(name, sightings, excess, None if placement is None else intersect(sightings, spheres, placement))
        for name, sightings in zip(first.names, by_light, strict=True)
    )
    return Lights(lights, excess, tuple(_notes(lights, excess, placement)))


def _light(name: str, sightings: Sequence[Sighting], excess: float, position: Position | None) -> Light:
    """The weighted mean of what the spheres see."""
    weights = np.array([1 / max(sighting.variance, 1e-30) for sighting in sightings])
    weights /= weights.sum()
    directions = np.stack([sighting.ray.direction for sighting in sightings])
    mean = weights @ directions
    mean /= np.linalg.norm(mean)
    changes = [weight * one.by_place.direction for weight, one in zip(weights, sightings, strict=True)]
    own = sum(change.T @ change for change in changes) + excess**2 / len(sightings) * (np.eye(3) - np.outer(mean, mean))
    common = np.concatenate([weight * one.by_outline.direction for weight, one in zip(weights, sightings, strict=True)])
    extent = combine([one.extent for one in sightings])
    return Light(name, mean, own, common, tuple(sightings), _apart(directions), position, extent)


def _apart(directions: np.ndarray) -> float | None:
    """Largest angle between some unit vectors [n, 3], rad; None of one."""
    if len(directions) < 2:
        return None
    # By the chord, which keeps the digits of small angles.
    chords = np.linalg.norm(directions[:, None] - directions[None], axis=2)
    return float(2 * np.arcsin(np.clip(chords.max() / 2, 0, 1)))


def _excess(by_light: Sequence[Sequence[Sighting]]) -> float:
    """Standard deviation of a tangential angle by which several spheres differ beyond their stated errors, rad."""
    scatter, stated = [], []
    for sightings in by_light:
        directions = np.stack([one.ray.direction for one in sightings])
        scatter.append(((directions - directions.mean(axis=0)) ** 2).sum() / (len(sightings) - 1) / 2)
        stated.append(np.mean([one.variance for one in sightings]))
    return float(np.sqrt(max(np.mean(scatter) - np.mean(stated), 0.0)))


def _notes(lights: Sequence[Light], excess: float, placement: Placement | None) -> list[str]:
    notes = []
    apart = [light.apart for light in lights if light.apart is not None]
    if apart and placement is None:
        stated = np.sqrt(np.mean([one.variance for light in lights for one in light.sightings]))
        if excess > (_DISAGREE**2 - 1) ** 0.5 * stated:
            notes.append(
                f"the spheres see the lights {np.degrees(np.median(apart)):.2g}° apart (median), more than their "
                "errors say; error bars include it. If the lights are near, --radius gives their positions."
            )
    lost = [light.name for light in lights if placement is not None and light.position is None]
    if lost:
        notes.append(
            f"no position of {', '.join(lost[:3])}{f' and {len(lost) - 3} more' if len(lost) > 3 else ''}: the rays "
            "from the spheres do not meet within their errors, so the light is distant, or the spheres are misplaced."
        )
    return notes
