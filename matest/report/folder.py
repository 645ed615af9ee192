"""Writing a result folder whole or not at all."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from matest.brdf import Brdf
from matest.capture import Capture
from matest.errors import InputError
from matest.estimation.prediction import PredictionErrors
from matest.estimation.result import Estimate
from matest.outputs import check_writable, json_text, write_text
from matest.places import whole_folder
from matest.progress import Progress, silent
from matest.report import manifest
from matest.report.maps import files_of_map, write_maps
from matest.report.page import page
from matest.report.photographs import worst_first
from matest.report.picture_size import PictureSize
from matest.report.pictures import write_pictures
from matest.report.previews import LARGE_PREVIEWS, LARGE_SIDE, PreviewPlan
from matest.report.raster import Raster, Window
from matest.report.relight import relighting
from matest.scene import Surface

# Pictures of results, from the folder.
_PICTURE = re.compile(r"images/(\d+_(photo|render|residual)|mean_residual|slices|incidences|posterior)\.png")
# What else a result has in its folder, by the file that marks it.
_FILES = {
    "result.json": ("result.json", "material.json", "report.html", "profile.csv", manifest.NAME),
    "prediction.json": ("prediction.json", "profile.csv"),
}


def check_destination(out: Path, marker: str) -> None:
    """Refuse to replace anything but an empty folder or an earlier result, and a place that cannot be written to.

    Args:
        out: the folder to be written.
        marker: the JSON file whose schema marks an earlier result.

    Raises:
        InputError: `out` is a file, or a folder with other things in it.
        OSError: nothing can be written there.
    """
    check_writable(out.parent if out.exists() and not out.is_symlink() else out)
    if out.is_dir() and (foreign := _foreign(out, marker)):
        raise InputError(
            f"{out}: would be replaced, but holds what matest did not write ({foreign}); give another folder with -o."
        )
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; give a folder with -o.")


def _foreign(out: Path, marker: str) -> str:
    """A file or folder in a folder that no earlier result put there; empty where there is none."""
    written = _written(out / marker)
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out).as_posix()
        folder = path.is_dir() and not path.is_symlink()
        if not (name in ("images", "maps") if folder and written else name in written or _is_picture(name, written)):
            return name
    return ""


def _is_picture(name: str, written: Collection[str]) -> bool:
    return bool(written) and _PICTURE.fullmatch(name) is not None


def _written(marker: Path) -> Collection[str]:
    """The files, but for pictures, of the result that a JSON file is of; none where it is none of matest's."""
    if not marker.is_file():
        return ()
    try:
        content = json.loads(marker.read_text("utf-8"))
        if not str(content["schema"]).startswith("matest."):
            return ()
        maps = [name for parameter in content.get("maps") or () for name in files_of_map(str(parameter))]
        predictions = [str(image["prediction"]) for image in content.get("images") or () if "prediction" in image]
        return {*_FILES[marker.name], *maps, *predictions}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return ()


def write_result(
    estimate: Estimate,
    capture: Capture,
    out: Path,
    progress: Progress = silent,
    *,
    pictures: PictureSize = PictureSize.PREVIEW,
    request: Mapping[str, Any] | None = None,
) -> Estimate:
    """Write the result folder of an estimate; returns the estimate with its timing completed.

    Writes `result.json`, `material.json`, `report.html`, `profile.csv`, `manifest.json`, and the pictures in `images/`,
    if there are any.

    Args:
        estimate: of the capture.
        capture: that it is of.
        out: the folder.
        progress: told that the report is written.
        pictures: how large they are.
        request: what decides on the result beside the capture, of plain types, for the manifest.
    """
    check_destination(out, "result.json")
    clock = time.perf_counter()
    progress("writing the report")
    with whole_folder(out) as folder:
        surface = capture.scene.surface
        step = pictures.step(Window.of(surface, pictures).shape)
        plan = _plan(estimate, capture, step, full=pictures is PictureSize.FULL) if step else None
        drawn = write_pictures(
            capture, estimate.material, folder, pictures, residual_scale=estimate.residual_scale, plan=plan
        )
        maps = write_maps(estimate, surface, folder, previews=plan is not None)
        relit = None if plan is None else relighting(estimate, capture.scene, _small_raster(surface))
        write_json(folder / "material.json", estimate.material_dict())
        timing = {**estimate.timing_s, "report": time.perf_counter() - clock}
        timing["total"] = sum(timing.values())
        estimate = replace(estimate, timing_s=timing)
        shown = None if plan is None else replace(drawn, maps=maps)
        write_text(folder / "report.html", page(estimate, capture.names, shown, relit))
        write_json(folder / "result.json", estimate.to_dict())
        manifest.write(folder, request or {}, capture.digests())
    return estimate


def _plan(estimate: Estimate, capture: Capture, step: int, *, full: bool) -> PreviewPlan:
    """Large previews of the photographs with the largest errors, small ones of the others."""
    worst = [image.file for image in worst_first(estimate.images)]
    order = sorted(range(len(capture)), key=lambda number: _place(worst, capture.names[number]))
    return PreviewPlan(capture.names, frozenset(order[:LARGE_PREVIEWS]), step, full)


def _place(names: list[str], name: str) -> int:
    """Of a name in a list; behind all where it is not in it."""
    return names.index(name) if name in names else len(names)


def _small_raster(surface: Surface) -> Raster:
    """The pixels that a large preview shows."""
    window = Window.of(surface)
    return Raster.of(surface, -(-max(window.shape) // LARGE_SIDE), window)


def write_json(path: Path, content: dict) -> None:
    """A JSON file for people to read too."""
    write_text(path, json_text(content, indent=1, ensure_ascii=False) + "\n")


def write_prediction(
    material: Brdf,
    errors: PredictionErrors,
    capture: Capture,
    out: Path,
    *,
    pictures: PictureSize = PictureSize.PREVIEW,
    maps: Collection[str] = (),
) -> None:
    """Write predicted images: `NN.exr` (linear radiance), the pictures of `write_pictures`, `prediction.json`.

    Args:
        material: that is shaded.
        errors: of it.
        capture: that gives geometry and lights.
        out: the folder.
        pictures: how large they are.
        maps: parameters of the material that have a value at every pixel.
    """
    check_destination(out, "prediction.json")
    with whole_folder(out) as folder:
        write_pictures(capture, material, folder, pictures, radiance=True)
        images = [
            {"image": name, "prediction": f"{number:02d}.exr", "relative_rmse": error, "median_error": median}
            for number, (name, error, median) in enumerate(
                zip(capture.names, errors.images, errors.medians, strict=True)
            )
        ]
        content = {
            "schema": "matest.prediction/1",
            "images": images,
            "relative_rmse": errors.pooled,
            "median_error": errors.pooled_median,
            "maps": [*maps],
        }
        write_json(folder / "prediction.json", content)
