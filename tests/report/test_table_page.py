"""The page, pictures and folder of a fit to a table."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from matest.brdf import CookTorrance
from matest.estimation.table_fit import TableFit, fit_table
from matest.report import table_plots
from matest.report.table_folder import write_fit
from matest.report.table_page import table_page
from matest.report.table_plots import plot_incidences, plot_posterior, plot_slices
from matest.report.tables import fit_table as terminal_table
from matest.report.tables import misfit_table
from matest.tables import Table
from tests.tables.goniometer import hemispherical, measured

SHOWN = {name: f"data:{name}" for name in ("slices", "incidences", "posterior")}


@pytest.fixture(scope="module")
def fit() -> TableFit:
    wi, wo = hemispherical()
    table = measured(CookTorrance([0.3, 0.2, 0.1], 1.0, 0.15), (wi[::6], wo[::6]))
    dark = table.values.clone()
    # Not positive: a logarithmic scale has no place for it.
    dark[:20] = 0
    return fit_table(Table(table.path, table.wi, table.wo, dark, table.channels), "cook-torrance", fix={"f0": 0.04})


def test_the_page_shows_pictures_and_errors(fit: TableFit) -> None:
    page = table_page(fit, SHOWN, "No relighting.")
    for picture in SHOWN.values():
        assert f'src="{picture}"' in page
    assert "Errors by incidence" in page
    assert "noise, estimated from the residuals" in page
    assert "<td>40°</td>" in page
    assert "Left out" not in page


def test_the_page_begins_with_the_verdict(fit: TableFit) -> None:
    verdict = "No model of the catalogue <fits> this table."
    estimate = replace(fit.estimate, warnings=[verdict, *fit.estimate.warnings])
    page = table_page(replace(fit, estimate=estimate), SHOWN, "")
    warnings = page.split('<p class="warning">')[1:]
    assert warnings[0].startswith("No model of the catalogue &lt;fits&gt; this table.")


def test_pictures_are_drawn(fit: TableFit, tmp_path: Path) -> None:
    plot_slices(fit, tmp_path / "slices.png")
    plot_incidences(fit, tmp_path / "incidences.png")
    plot_posterior(fit.estimate, tmp_path / "posterior.png")
    for name in ("slices", "incidences", "posterior"):
        picture = cv2.imread(str(tmp_path / f"{name}.png"))
        assert picture is not None
        assert picture.std() > 5


def test_the_correlation_is_between_channels_by_name(
    fit: TableFit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = []
    monkeypatch.setattr(table_plots, "_print", lambda figure, _: figures.append(figure))
    plot_posterior(fit.estimate, tmp_path / "posterior.png")
    ticks = {text.get_text() for axes in figures[0].axes for text in axes.get_xticklabels() + axes.get_yticklabels()}
    assert {f"diffuse {channel}" for channel in fit.samples.table.channels} <= ticks
    assert not any("[" in tick for tick in ticks)


def test_light_that_no_incidence_reflects_has_a_panel(fit: TableFit, tmp_path: Path) -> None:
    table = fit.samples.table
    nothing = fit.estimate.material.replace({"diffuse": 0.0, "specular": 0.0})
    dark = replace(fit.samples, table=replace(table, values=0 * table.values))
    plot_slices(replace(fit, samples=dark, estimate=replace(fit.estimate, material=nothing)), tmp_path / "slices.png")
    assert (tmp_path / "slices.png").is_file()


def test_a_folder_is_written_whole_with_its_provenance(fit: TableFit, tmp_path: Path) -> None:
    table = tmp_path / "simulated.csv"
    table.write_text("a")
    samples = replace(fit.samples, table=replace(fit.samples.table, path=table))
    complete = write_fit(replace(fit, samples=samples), tmp_path / "out", "matest fit")
    assert complete.estimate.provenance["command"] == "matest fit"
    assert json.loads((tmp_path / "out" / "result.json").read_text("utf-8")) == complete.to_dict()
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
    report = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert report.count('src="data:image/png;base64,') == 3
    assert "relight-data" in report


def test_terminal_tables_have_a_row_for_every_part(fit: TableFit) -> None:
    assert misfit_table("incidence", fit.incidences).row_count == 8
    assert terminal_table(fit).renderables
