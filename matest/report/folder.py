"""Writing a result folder whole or not at all."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from matest.brdf import Brdf
from matest.capture import Capture
from matest.errors import InputError
from matest.estimation.prediction import PredictionErrors
from matest.estimation.result import Estimate
from matest.progress import Progress, silent
from matest.report.maps import write_maps
from matest.report.page import page
from matest.report.picture_size import PictureSize
from matest.report.pictures import write_pictures

# What matest writes into a result or prediction folder; a folder with anything else in it is not replaced.
_WRITTEN_NAMES = {"result.json", "prediction.json", "material.json", "report.html", "profile.csv", "images", "maps"}


def check_destination(out: Path, marker: str) -> None:
    """Refuse to replace anything but an empty folder or an earlier result.

    Args:
        out: the folder to be written.
        marker: the JSON file whose schema marks an earlier result.

    Raises:
        InputError: `out` is a file, or a folder with other things in it.
    """
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    foreign = out.name
    if out.is_dir() and _is_by_matest(out / marker):
        names = [path.name for path in out.iterdir()]
        strangers = [name for name in names if name not in _WRITTEN_NAMES and not re.fullmatch(r"\d+\.exr", name)]
        if not strangers:
            return
        foreign = strangers[0]
    raise InputError(
        f"{out}: would be replaced, but holds what matest did not write ({foreign}); give another folder with -o."
    )


def _is_by_matest(file: Path) -> bool:
    """Whether a JSON file has one of matest's schemas."""
    try:
        return str(json.loads(file.read_text("utf-8"))["schema"]).startswith("matest.")
    except (OSError, ValueError, KeyError, TypeError):
        return False


@contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """A temporary folder beside `out` that takes its place when the block ends well, and vanishes otherwise."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(out)) from None
    previous = temporary.with_name(temporary.name + "-previous")
    try:
        yield temporary
        temporary.chmod(0o755)
        if out.exists():
            os.replace(out, previous)
        os.replace(temporary, out)
    except BaseException:
        if previous.exists() and not out.exists():
            os.replace(previous, out)
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    shutil.rmtree(previous, ignore_errors=True)


def write_result(
    estimate: Estimate,
    capture: Capture,
    out: Path,
    progress: Progress = silent,
    *,
    pictures: PictureSize = PictureSize.PREVIEW,
) -> Estimate:
    """Write the result folder of an estimate; returns the estimate with its timing completed.

    Writes `result.json`, `material.json`, `report.html`, `profile.csv` and the pictures in `images/`, if there are any.
    """
    check_destination(out, "result.json")
    clock = time.perf_counter()
    progress("writing the report")
    with whole_folder(out) as folder:
        write_pictures(capture, estimate.material, folder, pictures, residual_scale=estimate.residual_scale)
        write_maps(estimate, capture.scene.surface, folder, previews=pictures is not PictureSize.NONE)
        write_json(folder / "material.json", estimate.material_dict())
        timing = {**estimate.timing_s, "report": time.perf_counter() - clock}
        timing["total"] = sum(timing.values())
        estimate = replace(estimate, timing_s=timing)
        step = pictures.step(capture.scene.surface.shape)
        (folder / "report.html").write_text(page(estimate, capture.names, step), "utf-8")
        write_json(folder / "result.json", estimate.to_dict())
    return estimate


def write_json(path: Path, content: dict) -> None:
    """A JSON file for people to read too."""
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", "utf-8")


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
