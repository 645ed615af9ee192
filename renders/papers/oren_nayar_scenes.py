"""Figures 1 and 12 to 15 of Oren & Nayar 1994: rough objects and Lambert's law, rendered."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

import matest
from matest.brdf import OrenNayar, OrenNayarExact
from matest.photographs.photometry import srgb
from matest.profiles import compare
from matest.simulate import load_scene, radiance
from papers.drawing import BLACK, BLUE, GREEN, ORANGE, PINK, Drawn, Entry
from papers.rendered import GALLERY, Panel, rendered, scene_of, sheet

ROW = 128  # of the cross-section, through the belly of the vase
ALBEDO = 0.7
# Radiance of a matte surface of that albedo that faces the light of irradiance 3.
LAMBERT = 3.0 * ALBEDO / math.pi
WHITE = 0.75  # radiance shown as white


def figure_13() -> Drawn:
    """Photograph, both models and their cross-sections, lit from the viewer and from 20° to the right."""
    folder = GALLERY.parent / "figure-13"
    capture = matest.load_capture(folder)
    noise_free = load_scene(folder / "noise-free.toml")
    truth = [radiance(noise_free, number) for number in range(len(capture))]
    shaded = {}
    for name in ("oren-nayar", "lambert"):
        shaded[name], _ = matest.predict(matest.estimate(capture, name).material, capture)
    figure = Figure(figsize=(11, 7), layout="constrained")
    axes = figure.subplots(2, 4, width_ratios=(1, 1, 1, 2))
    sections = []
    for number, light in enumerate(("light at the viewer", "light 20° to the right")):
        photo = capture.scene.surface.image(capture.radiance(number))
        pictures = {"photograph": photo, "Oren-Nayar fit": shaded["oren-nayar"], "Lambert fit": shaded["lambert"]}
        for axis, (title, images) in zip(axes[number], pictures.items(), strict=False):
            picture = images if title == "photograph" else images[number]
            axis.imshow(srgb(np.asarray(picture[..., 0]) / WHITE), cmap="gray", vmin=0, vmax=255)
            axis.axhline(ROW, color=ORANGE, linewidth=0.6)
            axis.set_axis_off()
            axis.set_title(title if number == 0 else "")
        width = truth[number].shape[1]
        section = compare(
            [truth[number], shaded["oren-nayar"][number], shaded["lambert"][number]],
            ["noise-free", "Oren-Nayar fit", "Lambert fit"],
            (0.0, ROW, width - 1.0, ROW),
        )
        sections.append(section)
        styles = (("#999999", "-", 4.0), (BLUE, "-", 1.5), (ORANGE, "--", 1.5))
        for name, profile, rms, (colour, style, thick) in zip(
            section.names, section.profiles, section.rms, styles, strict=True
        ):
            label = name if rms == 0 else f"{name}, rms error {rms:.1g}"
            axes[number, 3].plot(section.distance, profile, style, color=colour, linewidth=thick, label=label)
        axes[number, 3].set_xlabel(f"pixel along the cross-section ({light})")
        axes[number, 3].set_ylabel("radiance")
        axes[number, 3].legend(frameon=False, loc="lower center", fontsize="small")
    front, side = sections
    flat, steep = at_60_degrees(front.profiles[0]), at_60_degrees(front.profiles[2])
    measured = (
        f"Where its normal is turned by 60° the vase has {flat:.2f} of the brightness of its middle, Lambert's fit "
        f"{steep:.2f} (light at the viewer). Errors along the cross-section (rms, "
        f"radiance): Oren-Nayar {front.rms[1]:.2g} and {side.rms[1]:.2g}, Lambert {front.rms[2]:.2g} and "
        f"{side.rms[2]:.2g}. With the light 20° to the right the vase is brightest at pixel {side.peak[0]:.0f}, "
        f"Oren-Nayar's fit at {side.peak[1]:.0f}, Lambert's at {side.peak[2]:.0f}. The photograph is a simulated one, "
        f"with noise. White is at radiance {WHITE:g}."
    )
    return Drawn(figure, measured, colours=128)


def at_60_degrees(profile: np.ndarray) -> float:
    """Brightness where the normal of a round body is turned by 60°, over that at its middle, of a section across it.

    The limbs are where the profile falls to nothing, to a part of a pixel by the share of the object in it.
    """
    inside = np.flatnonzero(profile > 0.02 * profile.max())
    left, right = inside[0], inside[-1]
    middle, radius = (left + right) / 2, (right - left + 1) / 2
    at = np.array([-1, 1]) * radius * math.sin(math.radians(60))
    return float(np.interp(middle + at, np.arange(len(profile)), profile).mean() / profile[round(middle)])


def figure_14() -> Drawn:
    scene = scene_of("oren-nayar-14")
    circle = scene.description.tables.geometry
    materials = {
        "σ = 0 (Lambert)": OrenNayar(albedo=ALBEDO, sigma=0.0),
        "σ = 10°": OrenNayar(albedo=ALBEDO, sigma=math.radians(10)),
        "σ = 20°": OrenNayar(albedo=ALBEDO, sigma=math.radians(20)),
        "σ = 40°": OrenNayar(albedo=ALBEDO, sigma=math.radians(40)),
        "σ = 40°, the integral": OrenNayarExact(albedo=ALBEDO, sigma=math.radians(40)),
    }
    images = {name: rendered(scene, material) for name, material in materials.items()}
    figure = sheet([[Panel(image, name, WHITE) for name, image in images.items()]], below=250)
    width, height = figure.get_size_inches() * 100
    axes = figure.add_axes((70 / width, 48 / height, (width - 90) / width, 190 / height))
    row = int(circle.centre[1])
    place = (np.arange(images["σ = 20°"].shape[1]) + 0.5 - circle.centre[0]) / circle.radius
    ratios = {}
    for (name, image), colour in zip(images.items(), (BLACK, GREEN, PINK, BLUE, ORANGE), strict=True):
        profile = image[row, :, 0]
        axes.plot(place, profile, "--" if "integral" in name else "-", color=colour, linewidth=1.4, label=name)
        sides = np.interp([-math.sin(math.pi / 3), math.sin(math.pi / 3)], place, profile)
        ratios[name] = float(sides.mean() / np.interp(0.0, place, profile))
    axes.set(xlabel="distance from the middle of the sphere, in radii", ylabel="radiance", xlim=(-1.02, 1.02))
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, fontsize="small", loc="lower center", ncols=3)
    rows = ["| σ | at 60° / at the middle |", "| --- | --- |"]
    rows += [f"| {name.removeprefix('σ = ')} | {value:.3f} |" for name, value in ratios.items()]
    middle = float(np.interp(0.0, place, images["σ = 40°"][row, :, 0]))
    measured = (
        "Brightness in the pictures where the normal is 60° from the view, over that of the middle. By eq. 16 it is "
        "0.832 at 40°, by the integral 0.848, and by Lambert's law ½. The rough sphere is a disc of nearly even "
        f"brightness, {middle / LAMBERT:.2f} of a facing Lambertian one in the middle. White is at "
        f"radiance {WHITE:g}.\n\n" + "\n".join(rows)
    )
    return Drawn(figure, measured)


def figure_15() -> Drawn:
    rows, faces, tops, sides, belly = [], [], [], [], []
    for sigma in (0, 30):
        material = OrenNayar(albedo=ALBEDO, sigma=math.radians(sigma))
        images = {name: rendered(scene_of("oren-nayar-15", f"{name}.toml"), material) for name in _OBJECTS}
        rows.append([Panel(image, f"σ = {sigma}°", WHITE) for image in images.values()])
        faces.append(even_faces(images["cube"]))
        middle = images["cylinder"].shape[0] // 2
        profile = images["cylinder"][middle, :, 0]
        tops.append(even_faces(images["cylinder"])[0] / profile.max())
        sides.append(at_60_degrees(profile))
        belly.append(at_60_degrees(images["vase"][images["vase"].shape[0] // 2, :, 0]))
    cube = ["/".join(f"{value / shades[-1]:.2f}" for value in shades) for shades in faces]
    measured = (
        f"From σ = 0 to 30° the three faces of the cube go from {cube[0]} to {cube[1]} of the brightest, the round "
        f"side of the cylinder turned by 60° from {sides[0]:.2f} to {sides[1]:.2f} of its middle, its flat top from "
        f"{tops[0]:.2f} to {tops[1]:.2f} of that middle, and the belly of the vase, turned by 60°, from {belly[0]:.2f} "
        f"to {belly[1]:.2f}. There is no ambient light. White is at radiance {WHITE:g}."
    )
    return Drawn(sheet(rows), measured)


_OBJECTS = ("vase", "cylinder", "cube")


def even_faces(image: np.ndarray) -> list[float]:
    """Radiances that at least a thousand pixels have in common, ascending: those of flat faces."""
    values, counts = np.unique(image[image > 0].round(4), return_counts=True)
    return values[counts > 1000].tolist()


FIGURES: dict[str, Entry] = {
    "figure-13": Entry(
        "Oren & Nayar 1994, figures 1, 12 and 13: a clay vase",
        "Lit from the viewer, the real vase is almost evenly bright and falls off only very near its limbs; Lambert's "
        "law darkens it all the way. With the light 20° to the right Lambert's law drops too fast toward the right "
        "limb and puts the brightest place well away from where it is. The model, ρ = 0.7 and σ = 40°, follows both.",
        figure_13,
    ),
    "gallery/oren-nayar-14": Entry(
        "Oren & Nayar 1994, figure 14: spheres of growing roughness, lit from the viewer",
        "With growing σ the sphere looks flatter, and at last like a flat disc of nearly constant brightness, as the "
        "full moon does.",
        figure_14,
    ),
    "gallery/oren-nayar-15": Entry(
        "Oren & Nayar 1994, figure 15: vase, cylindrical block and cube at σ = 0 and 30°, lit from the viewer",
        "Smooth (a), vase and cylinder shade strongly and three faces of the cube have clearly different brightnesses. "
        "Rough (b), the shading shrinks, and so does the contrast between the flat and round parts of the block and "
        "between the faces of the cube: moderate shading without any ambient light.",
        figure_15,
    ),
}
