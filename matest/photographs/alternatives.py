"""Other ways to read a capture: the mistakes that people make when they describe one, each undone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from matest.scene import DirectionalLight, PointLight, Surface
from matest.scene.lights import Light

if TYPE_CHECKING:
    from matest.photographs.photographs import Photographs

# Transfer functions that image files have, and how they are called.
_TRANSFERS: dict[str | float, str] = {"linear": "linear values", "srgb": "sRGB", 2.2: "a gamma of 2.2"}
# Least component of a normal map whose values were shifted into 0 to 1, and left there: noise may lie below 0.
_LEAST_SHIFTED = -0.02
# Share of the pixels whose normals must have been shifted, if the map was.
_MOST = 0.9
# Units that are taken for one another, metres and millimetres.
_UNIT = 1000.0


@dataclass(frozen=True)
class Alternative:
    """Photographs as they would be with one mistake undone.

    Attributes:
        cause: name of the mistake.
        finding: what seems to be the case, as a clause.
        instead: how the photographs are read here, as a phrase.
        mend: what to do about it, as a sentence.
        photographs: read that way.
        order: of each photograph the one whose stated lights are its own; empty where each has its own.
    """

    cause: str
    finding: str
    instead: str
    mend: str
    photographs: Photographs
    order: tuple[int, ...] = ()


# Gives what may have been meant instead, if it makes sense for these photographs.
Rule = Callable[["Photographs"], Iterator[Alternative]]


def alternatives(photographs: Photographs) -> Iterator[Alternative]:
    """Every other way to read some photographs, but for the order of their lights."""
    for rule in RULES:
        yield from rule(photographs)


def _normals_flipped(photographs: Photographs) -> Iterator[Alternative]:
    surface = photographs.scene.surface
    if surface.mesh is not None or surface.convex:
        return
    for axis, (name, points, colour) in enumerate([("x", "left", "red"), ("y", "down", "green")]):
        yield Alternative(
            f"normals {name} {points}",
            f"the normals' {name} axis points {points}",
            f"with {name} turned round",
            f"Change the sign of {name} of geometry.normals (in an image of integers: invert its {colour} channel).",
            _of_surface(photographs, replace(surface, normals=surface.normals * _sign(axis, surface.normals))),
        )


def _normals_shifted(photographs: Photographs) -> Iterator[Alternative]:
    surface = photographs.scene.surface
    negative = (surface.normals < _LEAST_SHIFTED).any(1)
    if surface.mesh is not None or surface.convex or bool(negative.double().mean() > 1 - _MOST):
        return
    # A stored vector of length L times the given unit vector u is (n + 1) / 2 of a unit vector n: 2L² − 2L Σu + 1 = 0.
    # Of the two vectors the longer one is taken; where the other one faces the viewer too, no one can tell.
    total = surface.normals.sum(1, keepdim=True)
    root = (total * total - 2).clamp(min=0).sqrt()
    long, short = (normalize((total + sign * root) * surface.normals - 1, dim=1) for sign in (1, -1))
    facing, doubtful = ((normals * surface.view).sum(1) > 0 for normals in (long, short))
    clear = (facing & ~doubtful & (total[:, 0] ** 2 > 2)).numpy()
    if clear.mean() > _MOST:
        yield Alternative(
            "normals 0 to 1",
            "the normals are stored as 0 to 1 and read as −1 to 1",
            "read as 0 to 1",
            "Store 2·n − 1 in geometry.normals, or an image of integers, whose values are read that way.",
            _of_surface(photographs, replace(surface, normals=long, rim=surface.rim | ~clear)),
        )


def _lights_mirrored(photographs: Photographs) -> Iterator[Alternative]:
    for axis, (name, points) in enumerate([("x", "left"), ("y", "down")]):

        def mirrored(vector: Tensor, axis: int = axis) -> Tensor:
            return vector * _sign(axis, vector)

        yield Alternative(
            f"lights {name} {points}",
            f"the lights' {name} axis points {points}",
            f"with {name} of the lights turned round",
            f"Change the sign of {name} of every light.",
            _of_lights(photographs, mirrored, mirrored),
        )


def _lights_negated(photographs: Photographs) -> Iterator[Alternative]:
    if _all(photographs, DirectionalLight):
        yield Alternative(
            "lights point away",
            "the directions of the lights point the way that light travels",
            "with lights turned round",
            "Change the sign of every direction: they point from the surface to the light.",
            _of_lights(photographs, torch.neg, torch.neg),
        )


def _half_vectors(photographs: Photographs) -> Iterator[Alternative]:
    if not _all(photographs, DirectionalLight):
        return
    view = normalize(photographs.scene.surface.view.double().mean(0), dim=0)
    yield Alternative(
        "half vectors for lights",
        "the directions of the lights are half vectors, the normals of a mirror ball where it shows the light",
        "with the direction of the camera mirrored at them",
        "Give 2·(h·v)·h − v as the direction, where h is the half vector and v points to the camera.",
        _of_lights(photographs, lambda half: 2 * (half @ view) * half - view, None),
    )
    yield Alternative(
        "reflections for lights",
        "the directions of the lights are mirrored twice",
        "with the half vectors between them and the camera",
        "Give the normals of the mirror ball where it shows the light as the directions.",
        _of_lights(photographs, lambda light: normalize(light + view, dim=0), None),
    )


def _transfer(photographs: Photographs) -> Iterator[Alternative]:
    encoding, integers = photographs.encoding, photographs.stored[0].dtype.kind == "u"
    if not integers and encoding.transfer == "linear":
        return
    for transfer, name in _TRANSFERS.items():
        if transfer != encoding.transfer:
            stated = repr(transfer).replace("'", '"')
            yield Alternative(
                f"transfer {transfer}",
                f"the images hold {name}, not what encoding.transfer says",
                f"read as {name}",
                f"Set encoding.transfer = {stated}.",
                replace(photographs, encoding=replace(encoding, transfer=transfer)),
            )


def _units(photographs: Photographs) -> Iterator[Alternative]:
    if not _all(photographs, PointLight):
        return
    for factor, mesh, lights in [(_UNIT, "millimetres", "metres"), (1 / _UNIT, "metres", "millimetres")]:

        def scaled(position: Tensor, factor: float = factor) -> Tensor:
            return factor * position

        yield Alternative(
            f"lights in {lights}, surface in {mesh}",
            f"the lights are placed in {lights}, the surface in {mesh}",
            "with both in one unit",
            f"Give the positions of the lights times {factor:g}, and their intensities times {factor**2:g}.",
            _of_lights(photographs, None, scaled, power=factor**2),
        )


# All of them, one after another.
RULES: tuple[Rule, ...] = (
    _normals_flipped,
    _normals_shifted,
    _lights_mirrored,
    _lights_negated,
    _half_vectors,
    _transfer,
    _units,
)


def in_order(photographs: Photographs, order: tuple[int, ...]) -> Alternative:
    """The photographs, each with the lights that are stated for another: `order` has the number of that one."""
    scene = photographs.scene
    taken = replace(
        scene,
        lights=tuple(scene.lights[number] for number in order),
        ambient=scene.ambient[list(order)],
        shadows=tuple(scene.shadows[number] for number in order) if scene.shadows else (),
        shadow_edge=tuple(scene.shadow_edge[number] for number in order) if scene.shadow_edge else (),
    )
    cause, finding = _disorder(order, photographs.names)
    return Alternative(
        cause,
        finding,
        "with lights in the order that fits",
        f"Give the images, in their order, the lights that are stated for images {', '.join(map(str, order))}.",
        replace(photographs, scene=taken),
        order,
    )


def _disorder(order: tuple[int, ...], names: Sequence[str]) -> tuple[str, str]:
    """What is wrong with the order of lights, in a name and a clause."""
    count = len(order)
    moved = [number for number in range(count) if order[number] != number]
    if order == tuple((order[0] + number) % count for number in range(count)):
        steps = min(order[0], order[0] - count, key=abs)
        many, side = abs(steps), "after" if steps > 0 else "before"
        amount = many if many > 1 else "one"
        places = f"{many} places {side}" if many > 1 else f"just {side}"
        return f"lights shifted by {amount}", f"the lights are shifted by {amount} (an image's are stated {places} it)"
    if order == tuple(reversed(range(count))):
        return "lights in reverse", "the lights are stated in reverse order"
    if len(moved) == 2:
        return "lights swapped", f"the lights of {names[moved[0]]} and {names[moved[1]]} are swapped"
    return "lights in another order", f"{len(moved)} of {count} images are stated to be under the lights of others"


def _of_surface(photographs: Photographs, surface: Surface) -> Photographs:
    return replace(photographs, scene=replace(photographs.scene, surface=surface))


def _of_lights(
    photographs: Photographs,
    direction: Callable[[Tensor], Tensor] | None,
    position: Callable[[Tensor], Tensor] | None,
    power: float = 1.0,
) -> Photographs:
    """The photographs with other directions of distant lights and positions of near ones, and their shadows."""

    def changed(light: Light) -> Light:
        if isinstance(light, DirectionalLight) and direction is not None:
            return replace(light, direction=direction(light.direction))
        if isinstance(light, PointLight) and position is not None:
            return replace(light, position=position(light.position), intensity=power * light.intensity)
        return light

    lights = tuple(tuple(changed(light) for light in some) for some in photographs.scene.lights)
    return replace(photographs, scene=replace(photographs.scene, lights=lights).with_shadows())


def _all(photographs: Photographs, kind: type) -> bool:
    """Whether every light is of a kind, and there is one."""
    lights = [light for some in photographs.scene.lights for light in some]
    return bool(lights) and all(isinstance(light, kind) for light in lights)


def _sign(axis: int, like: Tensor) -> Tensor:
    """−1 for one of three axes, 1 for the others."""
    return like.new_tensor(np.where(np.arange(3) == axis, -1.0, 1.0))
