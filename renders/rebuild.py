"""Rebuild everything in this folder from its scenes: `python renders/rebuild.py [FOLDER...]`.

The mesh of the vase is made here; every scene is then rendered as `matest render` does. The same versions of the
libraries give the same bits.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh
from scipy.interpolate import PchipInterpolator

from matest.simulate import simulate

HERE = Path(__file__).parent
# Radius of the vase at heights from foot to lip: nearly a cylinder, as the clay vase of Oren & Nayar's figure 12.
HEIGHT = (-1.0, -0.97, -0.9, -0.6, -0.2, 0.2, 0.5, 0.7, 0.8, 0.88, 0.95, 1.0)
RADIUS = (0.36, 0.40, 0.43, 0.54, 0.62, 0.60, 0.48, 0.335, 0.30, 0.31, 0.36, 0.40)
RINGS, SECTIONS = 72, 96


def vase() -> trimesh.Trimesh:
    """A closed surface of revolution about the y axis."""
    height = np.linspace(HEIGHT[0], HEIGHT[-1], RINGS)
    radius = PchipInterpolator(HEIGHT, RADIUS)(height)
    outline = np.concatenate([[[0, HEIGHT[0]]], np.stack([radius, height], axis=1), [[0, HEIGHT[-1]]]])
    mesh = trimesh.creation.revolve(outline, sections=SECTIONS)
    # trimesh revolves about z; the camera's up is y.
    mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    mesh.vertices = mesh.vertices.round(7)
    return mesh


def main(names: list[str]) -> None:
    scenes = sorted(HERE.glob("*/scene.toml"))
    for scene in scenes:
        if names and scene.parent.name not in names:
            continue
        if 'mesh = "vase.ply"' in scene.read_text("utf-8"):
            (scene.parent / "vase.ply").write_bytes(vase().export(file_type="ply"))
        print(simulate(scene))


if __name__ == "__main__":
    main(sys.argv[1:])
