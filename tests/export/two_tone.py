"""A vase of two colours seen from several sides, and its maps: for tests of textures."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import torch
import trimesh

from matest.batch import jobs, run
from matest.brdf import Brdf, OrenNayar
from matest.estimation.options import Options
from matest.estimation.parameter_map import ParameterMap, TexelStatus
from matest.export.atlas import Atlas, atlas_of
from matest.export.texture import Coverage, Texture, View, merged
from matest.export.textured import Textured
from matest.scene import Camera, Scene
from matest.scene.mesh import Mesh
from matest.scene.surface import from_mesh
from matest.shading import render
from tests.captures import directional, put_image, toml
from tests.simulated import DIRECTIONS

LEFT, RIGHT = (0.7, 0.5, 0.3), (0.2, 0.3, 0.6)
STD = 0.01
SIGMA = 0.4
NOISE = 0.004
SHAPE = (128, 96)


@cache
def vase(texture: bool = False) -> Mesh:
    """A body of revolution about y, its inside hollow; with texture coordinates if asked for."""
    rows, columns = 48, 96
    t = np.linspace(0, 1, rows + 1)
    y = np.linspace(-1, 1, rows + 1)
    radius = 0.45 + 0.2 * np.sin(2.2 * np.pi * t + 0.3)
    v, u = np.meshgrid(t, np.linspace(0, 1, columns + 1), indexing="ij")
    angle = 2 * np.pi * u
    vertices = np.stack(
        [radius[:, None] * np.sin(angle), np.broadcast_to(y[:, None], u.shape), radius[:, None] * np.cos(angle)], -1
    )
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    above = corner + columns + 1
    faces = np.concatenate([np.stack([corner, corner + 1, above + 1], 1), np.stack([corner, above + 1, above], 1)])
    uv = np.stack([0.02 + 0.96 * u.ravel(), 0.02 + 0.96 * v.ravel()], 1) if texture else None
    return Mesh(vertices.reshape(-1, 3), faces, uv=uv)


def camera(degrees: float, perspective: bool = False) -> Camera:
    """To the vase, from an angle about its axis."""
    angle = np.radians(degrees)
    place = (5 * float(np.sin(angle)), 0.6, 5 * float(np.cos(angle)))
    return Camera(place, fov_y=0.5) if perspective else Camera(place, height=2.4)


def truth(points: np.ndarray) -> np.ndarray:
    """Albedo of places on the vase [n, 3]: one colour above a slanted plane, another below."""
    return np.where((points[:, 1] > 0.4 * points[:, 0])[:, None], LEFT, RIGHT)


def to_edge(points: np.ndarray) -> np.ndarray:
    """Distance of places from the edge between the colours [n]."""
    return np.abs(points[:, 1] - 0.4 * points[:, 0]) / np.hypot(1, 0.4)


def view(degrees: float, *, seed: int = 0, perspective: bool = False, scale: float = 1.0) -> View:
    """The vase from an angle, with a map of its albedo that has noise."""
    seen = camera(degrees, perspective)
    surface = from_mesh(vase(), seen, SHAPE)
    assert surface.positions is not None
    true = truth(surface.positions.numpy())
    noise = STD * np.random.default_rng(seed).standard_normal(true.shape)
    values = torch.from_numpy(scale * (true + noise)).float()
    status = torch.full((len(surface),), TexelStatus.DETERMINED, dtype=torch.uint8)
    each = ParameterMap("albedo", values, torch.full_like(values, scale * STD), status)
    return View(surface, seen, {"albedo": each})


def capture(folder: Path, degrees: float, *, mesh: str = "../vase.obj", strength: float | None = 3.0) -> Path:
    """Write a capture of the vase from an angle: six lights about the camera, whose strength may be withheld."""
    seen = camera(degrees)
    surface = from_mesh(vase(), seen, SHAPE)
    turn = seen.axes().T
    lights = [directional(tuple(turn @ np.array(direction)), *(3 * [3.0])) for direction in DIRECTIONS]
    scene = Scene(surface, tuple((light,) for light in lights), torch.zeros(len(lights), 3, dtype=torch.float64))
    material = OrenNayar(torch.from_numpy(truth(surface.positions.numpy())), SIGMA)
    images = render(scene.with_shadows(), material).numpy()
    noise = np.random.default_rng(int(degrees)).standard_normal(images.shape)
    folder.mkdir(parents=True)
    power = {} if strength is None else {"irradiance": strength}
    tables = {
        "mask": "mask.png",
        "geometry": {"mesh": mesh},
        "camera": {"position": list(seen.position), "height": seen.height},
        "noise": {"read": NOISE},
        "image": [
            {"file": f"{number}.npy", "lights": [{"direction": light.direction.tolist(), **power}]}
            for number, light in enumerate(lights)
        ],
    }
    for number, image in enumerate(images + NOISE * noise):
        put_image(folder / f"{number}.npy", image.astype(np.float32))
    put_image(folder / "mask.png", (255 * surface.mask).astype(np.uint8))
    (folder / "capture.toml").write_text(toml(tables), "utf-8")
    return folder


def save_mesh(path: Path) -> None:
    """Write the vase as OBJ, without texture coordinates."""
    trimesh.Trimesh(vase().vertices, vase().faces, process=False).export(path)


@cache
def results() -> tuple[Path, ...]:
    """Result folders of the vase from three sides; the last does not know the strength of its lights."""
    folder = Path(tempfile.mkdtemp(prefix="matest-vase-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    save_mesh(folder / "vase.obj")
    captures = [capture(folder / f"{angle}", angle, strength=None if angle == 240 else 3.0) for angle in (0, 120, 240)]
    options = Options(model="oren-nayar", maps="albedo")
    made = [run(job) for job in jobs(captures, folder / "results", options)]
    assert not any(outcome.error for outcome in made), made
    return tuple(outcome.job.out for outcome in made)


@cache
def _three_views() -> tuple[Atlas, Texture, Coverage]:
    atlas = atlas_of(vase(texture=True), "result")
    textures, coverage, _ = merged(atlas, [view(angle, seed=angle) for angle in (0, 120, 240)], 256)
    return atlas, textures["albedo"], coverage


def textured(material: Brdf, name: str, *, exact: bool = False) -> Textured:
    """A material with the albedo of the vase as a texture of one of its parameters.

    It is merged from three views, or as it is at the texels where it shall be exact.
    """
    atlas, found, coverage = _three_views()
    if exact:
        texels = atlas.texels(256)
        image = np.zeros((256 * 256, 3), np.float32)
        image[texels.places] = truth(texels.mixed(atlas.mesh.triangles))
        status = np.zeros(256 * 256, np.uint8)
        status[texels.places] = TexelStatus.DETERMINED
        value, std = image.reshape(256, 256, 3), np.full((256, 256, 3), 1e-6, np.float32)
        found = Texture(value, std, status.reshape(256, 256), found.mean)
    return Textured(material.replace({name: torch.from_numpy(found.mean)}), atlas, {name: found}, coverage)
