"""Scene files for tests: written as text, rendered and estimated as users do."""

from __future__ import annotations

from pathlib import Path

import trimesh

LIGHTS = (
    [0.1, 0.2, 0.97],
    [0.7, 0.2, 0.68],
    [-0.7, 0.3, 0.65],
    [0.2, 0.85, 0.48],
    [-0.5, -0.6, 0.62],
    [0.95, 0.1, 0.3],
)
NOISE = "[noise]\nread = 0.002\ngain = 0.0005\nbits = 16\nseed = {seed}\n"
SPHERE = """[geometry]
shape = "sphere"
centre = [{half}, {half}]
radius = {radius}
[camera]
resolution = [{size}, {size}]
"""


def write(folder: Path, *parts: str) -> Path:
    """A scene.toml in `folder` made of its parts."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "scene.toml"
    file.write_text("\n".join(parts), "utf-8")
    return file


def path(key: str) -> str:
    """The parameter path of a keyword: `oren_nayar__sigma` is oren-nayar.sigma."""
    name, separator, inner = key.partition("__")
    return f"{name.replace('_', '-')}.{inner}" if separator else key


def material(model: str, **values: object) -> str:
    """A [material] table."""
    return "\n".join([f'[material]\nmodel = "{model}"', *(f'"{path(key)}" = {value}' for key, value in values.items())])


def sphere(size: int = 64) -> str:
    return SPHERE.format(size=size, half=size / 2, radius=0.45 * size)


def distant(directions: tuple[list[float], ...] = LIGHTS, irradiance: object = 3.0) -> str:
    return "\n".join(f"[[image]]\nlights = [ {{ direction = {d}, irradiance = {irradiance} }} ]" for d in directions)


def noise(seed: int = 1) -> str:
    return NOISE.format(seed=seed)


def near(positions: tuple[list[float], ...], intensity: float) -> str:
    return "\n".join(f"[[image]]\nlights = [ {{ position = {p}, intensity = {intensity} }} ]" for p in positions)


def notched_mesh(folder: Path) -> str:
    """A ball on a tilted slab, which casts a shadow on it. Returns the [geometry] table."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    ball.apply_translation([0.25, 0.15, 0.62])
    slab = trimesh.creation.box([2.4, 2.4, 0.2], transform=trimesh.transformations.rotation_matrix(0.5, [1, 0.3, 0]))
    # Small faces: smooth shading rounds the edges of a box over the width of one.
    slab = slab.subdivide().subdivide().subdivide().subdivide().subdivide()
    folder.mkdir(parents=True, exist_ok=True)
    trimesh.util.concatenate([ball, slab]).export(folder / "mesh.ply")
    return '[geometry]\nmesh = "mesh.ply"\n'
