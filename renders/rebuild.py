"""Rebuild everything in this folder from its scenes: `python renders/rebuild.py [FOLDER...]`.

The mesh of the vase is made here; every scene is then rendered as `matest render` does, and the figure of the paper is
drawn from its estimates. The same versions of the libraries give the same bits.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.interpolate import PchipInterpolator

import matest
from matest.profiles import compare
from matest.simulate import load_scene, radiance, simulate

HERE = Path(__file__).parent
# Radius of the vase at heights from foot to lip: nearly a cylinder, as the clay vase of Oren & Nayar's figure 12.
HEIGHT = (-1.0, -0.97, -0.9, -0.6, -0.2, 0.2, 0.5, 0.7, 0.8, 0.88, 0.95, 1.0)
RADIUS = (0.36, 0.40, 0.43, 0.54, 0.62, 0.60, 0.48, 0.335, 0.30, 0.31, 0.36, 0.40)
RINGS, SECTIONS = 72, 96
ROW = 128  # of the cross-section, through the belly


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


def figure_13(folder: Path) -> None:
    """Photograph, both models and their cross-sections, lit from the viewer and from 20° to the right."""
    capture = matest.load_capture(folder)
    noise_free = load_scene(folder / "noise-free.toml")
    truth = [radiance(noise_free, number) for number in range(len(capture))]
    shaded = {}
    for name in ("oren-nayar", "lambert"):
        shaded[name], _ = matest.predict(matest.estimate(capture, name).material, capture)
    figure = Figure(figsize=(11, 7), layout="constrained")
    axes = figure.subplots(2, 4, width_ratios=(1, 1, 1, 2))
    for number, light in enumerate(("light at the viewer", "light 20° to the right")):
        photo = capture.scene.surface.image(capture.radiance(number))
        pictures = {"photograph": photo, "Oren-Nayar fit": shaded["oren-nayar"], "Lambert fit": shaded["lambert"]}
        for axis, (title, images) in zip(axes[number], pictures.items(), strict=False):
            picture = images if title == "photograph" else images[number]
            axis.imshow(picture[..., 0] ** (1 / 2.2), cmap="gray", vmin=0, vmax=1.3 * float(photo.max()) ** (1 / 2.2))
            axis.axhline(ROW, color="#D55E00", linewidth=0.6)
            axis.set_axis_off()
            axis.set_title(title if number == 0 else "")
        width = truth[number].shape[1]
        found = compare(
            [truth[number], shaded["oren-nayar"][number], shaded["lambert"][number]],
            ["noise-free", "Oren-Nayar fit", "Lambert fit"],
            (0.0, ROW, width - 1.0, ROW),
        )
        styles = (("#999999", "-", 4.0), ("#0072B2", "-", 1.5), ("#D55E00", "--", 1.5))
        for name, profile, rms, (colour, style, thick) in zip(
            found.names, found.profiles, found.rms, styles, strict=True
        ):
            label = name if rms == 0 else f"{name}, rms error {rms:.1g}"
            axes[number, 3].plot(found.distance, profile, style, color=colour, linewidth=thick, label=label)
        axes[number, 3].set_xlabel(f"pixel along the cross-section ({light})")
        axes[number, 3].set_ylabel("radiance")
        axes[number, 3].legend(frameon=False, loc="lower center", fontsize="small")
    FigureCanvasAgg(figure).print_png(folder / "figure.png")


def main(names: list[str]) -> None:
    """Rebuild the named folders, or all."""
    for scene in sorted(HERE.glob("*/scene.toml")):
        folder = scene.parent
        if names and folder.name not in names:
            continue
        if 'mesh = "vase.ply"' in scene.read_text("utf-8"):
            (folder / "vase.ply").write_bytes(vase().export(file_type="ply"))
        simulate(scene)
        if folder.name == "figure-13":
            figure_13(folder)
        print(folder)


if __name__ == "__main__":
    main(sys.argv[1:])
