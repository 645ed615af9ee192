"""The result folder of a fit to a measured table."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import matest
from matest.capture.digests import digest
from matest.estimation.table_fit import TableFit
from matest.outputs import write_text
from matest.places import whole_folder
from matest.progress import Progress, silent
from matest.report.folder import check_destination, write_json
from matest.report.packing import data_uri
from matest.report.relight import relit_sphere
from matest.report.table_page import table_page
from matest.report.table_plots import plot_incidences, plot_posterior, plot_slices


def write_fit(fit: TableFit, out: Path, command: str = "", progress: Progress = silent) -> TableFit:
    """Write the result folder of a fit; returns the fit with its provenance and timing completed.

    Writes `result.json`, `material.json`, `report.html`, and in `images/` the pictures of `table_plots`.
    """
    check_destination(out, "result.json")
    clock, path = time.perf_counter(), fit.samples.table.path
    progress("writing the report")
    provenance = {"matest": matest.__version__, "command": command, "inputs": {path.name: digest(path)}}
    with whole_folder(out) as folder:
        (folder / "images").mkdir()
        places = {name: folder / "images" / f"{name}.png" for name in ("slices", "incidences", "posterior")}
        plot_slices(fit, places["slices"])
        plot_incidences(fit, places["incidences"])
        plot_posterior(fit.estimate, places["posterior"])
        pictures = {name: data_uri(place.read_bytes(), "image/png") for name, place in places.items()}
        relit = relit_sphere(fit.estimate)
        timing = {**fit.estimate.timing_s, "report": time.perf_counter() - clock}
        timing["total"] = sum(timing.values())
        fit = replace(fit, estimate=replace(fit.estimate, timing_s=timing, provenance=provenance))
        write_json(folder / "material.json", fit.estimate.material_dict())
        write_text(folder / "report.html", table_page(fit, pictures, relit))
        write_json(folder / "result.json", fit.to_dict())
    return fit
