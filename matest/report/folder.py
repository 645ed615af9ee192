"""Writing a result folder whole or not at all."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from matest.brdf import Brdf
from matest.capture import Capture
from matest.capture.images import write_image
from matest.errors import InputError
from matest.report.page import page
from matest.report.pictures import write_pictures
from matest.result import Estimate
from matest.shader import render_image


def check_destination(out: Path, marker: str) -> None:
    """Refuse to replace a folder that is not an earlier result (one without the file `marker`).

    Raises:
        InputError: `out` is a file, or a folder with other things in it.
    """
    if out.exists() and not (out.is_dir() and ((out / marker).is_file() or not any(out.iterdir()))):
        raise InputError(f"{out}: exists and is no earlier result of matest; give another folder with -o.")


@contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """A temporary folder beside `out` that takes its place when the block ends well, and vanishes otherwise."""
    out.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    try:
        yield temporary
        temporary.chmod(0o755)
        if out.exists():
            previous = temporary.with_name(temporary.name + "-previous")
            os.replace(out, previous)
            os.replace(temporary, out)
            shutil.rmtree(previous)
        else:
            os.replace(temporary, out)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def write_result(
    estimate: Estimate, capture: Capture, out: Path, progress: Callable[[str], None] = lambda _: None
) -> Estimate:
    """Write the result folder of an estimate; returns the estimate with its timing completed.

    Writes `result.json`, `material.json`, `report.html`, `profile.csv` and the pictures in `images/`.
    """
    check_destination(out, "result.json")
    clock = time.perf_counter()
    progress("writing the report")
    with whole_folder(out) as folder:
        write_pictures(capture, estimate.material, folder)
        _write_json(folder / "material.json", estimate.material_dict())
        timing = {**estimate.timing_s, "report": time.perf_counter() - clock}
        timing["total"] = sum(timing.values())
        estimate = replace(estimate, timing_s=timing)
        (folder / "report.html").write_text(page(estimate, len(capture)), "utf-8")
        _write_json(folder / "result.json", estimate.to_dict())
    return estimate


def _write_json(path: Path, content: dict) -> None:
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", "utf-8")


def write_prediction(material: Brdf, errors: list[float], capture: Capture, out: Path) -> None:
    """Write predicted images: `NN.exr` (linear radiance), the pictures of `write_pictures`, `prediction.json`."""
    check_destination(out, "prediction.json")
    with whole_folder(out) as folder:
        for number in range(len(capture)):
            image = render_image(capture.scene, number, material).detach().numpy()
            write_image(folder / f"{number:02d}.exr", image)
        write_pictures(capture, material, folder)
        images = [
            {"image": file.name, "prediction": f"{number:02d}.exr", "relative_rmse": error}
            for number, (file, error) in enumerate(zip(capture.files, errors, strict=True))
        ]
        _write_json(folder / "prediction.json", {"schema": "matest.prediction/1", "images": images})
