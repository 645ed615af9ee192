"""Photographs and residuals by angle in a report."""

from __future__ import annotations

import re
from dataclasses import replace

import torch

from matest.estimation.photographs import PhotographFit, Turn
from matest.estimation.residual_angles import AngularResiduals
from matest.report.page import page
from matest.report.photographs import angle_drawings, legend_of, photograph_table, sortable_table
from tests.estimates import clay
from tests.report.pages import words
from tests.report.test_page import names, pictures

EVIL = "<b>$&.png"
FINE = PhotographFit("fine.png", 0.012, 1.0004, 0.0007, 1.02, Turn(0.05, 0.03, [0.0, 0.6, 0.8]))
TURNED = replace(
    FINE, file="turned.png", direction=Turn(3.04, 0.03, [0.0, 0.6, 0.8]), stands_out="direction", times=41.0
)


def long_capture(count: int) -> list[PhotographFit]:
    return [replace(FINE, file=f"{k:03d}.png", reduced_chi2=1 + k, relative_rmse=0.01 * (1 + k)) for k in range(count)]


def test_photographs_are_listed_worst_first_and_those_that_stand_out_before_them() -> None:
    head, body, odd = photograph_table([*long_capture(3), TURNED])
    assert [cells[0] for cells in body] == ["turned.png", "002.png", "001.png", "000.png"]
    assert odd == [0]
    assert body[0] == (
        "turned.png",
        "1.20%",
        "1.02",
        "1.000 ± 0.001",
        "3.0 ± 0.1° to (0.00, 0.60, 0.80)",
        "41 (direction)",
    )
    assert len(head) == len(body[0])


def test_where_nothing_stands_out_no_column_says_so() -> None:
    head, body, odd = photograph_table(long_capture(2))
    assert odd == []
    assert len(head) == len(body[0]) == 5
    assert "times the usual" not in head


def test_all_photographs_are_listed_and_those_not_fitted_last() -> None:
    images = long_capture(96)
    table = sortable_table(images, ["held out.png", *(image.file for image in images)])
    numbers = re.findall(r'<tr data-image="(\d+)"', table)
    assert numbers == [str(k) for k in [*range(96, 0, -1), 0]]
    assert "not fitted" in table.split("held out.png")[1]


def test_the_last_column_is_sorted_by_how_far_a_photograph_stands_out() -> None:
    unknown = replace(FINE, level=None, level_std=None, direction=None)
    odd = replace(unknown, file="odd.png", stands_out="misfit", times=7.0)
    table = sortable_table([unknown, odd], ["fine.png", "odd.png"])
    assert "data-key=7>7 (misfit)" in table


def test_without_a_viewer_names_are_no_buttons() -> None:
    rows = sortable_table([FINE], ["fine.png"], viewer=False).split("<tbody>")[1]
    assert "button" not in rows
    assert "fine.png" in rows


def test_cells_are_sorted_by_numbers_and_not_by_their_text() -> None:
    table = sortable_table([replace(FINE, relative_rmse=0.0123456)], ["fine.png"])
    assert "data-key=0.0123456>1.23%" in table


def test_what_is_not_known_of_a_photograph_has_a_dash() -> None:
    unknown = replace(FINE, file="unknown.png", level=None, level_std=None, direction=None)
    _, body, _ = photograph_table([FINE, unknown])
    assert {cells[0]: cells[3:] for cells in body}["unknown.png"] == ("-", "-")


def test_where_no_light_is_judged_no_column_and_no_legend_tell_of_it() -> None:
    unknown = replace(FINE, level=None, level_std=None, direction=None)
    head, body, _ = photograph_table([unknown, unknown])
    assert head == ("photograph", "relative rms error", "χ²")
    assert [len(cells) for cells in body] == [3, 3]
    assert legend_of([unknown]) == ""
    assert "Turn" not in words(page(clay(images=[unknown]), ["fine.png"], None))


def test_a_turn_that_may_be_chance_goes_nowhere() -> None:
    (cells,) = photograph_table([FINE])[1]
    assert cells[-1] == "0.1 ± 0.1°"


def residuals(count: int) -> AngularResiduals:
    places = torch.linspace(5, 80, count, dtype=torch.float64)
    return AngularResiduals(places, -0.002 * places, 0.1 + 0.001 * places, torch.full_like(places, 0.02))


def test_the_page_has_photographs_and_residuals_by_angle() -> None:
    text = page(
        clay(
            images=[replace(FINE, file=EVIL), TURNED],
            residuals={"half angle": residuals(20), "angle of incidence": residuals(3)},
        ),
        [EVIL, "turned.png"],
        pictures(2),
    )
    said = words(text)
    assert EVIL in said
    assert "<b>" not in text
    drawn = text.split('id="residuals"')[1].split("</section>")[0]
    assert drawn.count("<svg") == 2
    assert "half angle (degrees)" in said
    assert "rms of the noise alone" in said
    assert drawn.count("<polyline") == 6
    assert "nan" not in drawn
    assert drawn.count("<figure") == 2 + 1


def test_an_estimate_of_a_table_has_neither() -> None:
    said = words(page(clay(), names(1), None))
    assert "Photographs" not in said
    assert "Residuals" not in said


def test_one_class_of_angles_is_no_curve() -> None:
    assert angle_drawings({"half angle": residuals(1)})[0] == []


def test_a_single_photograph_has_no_mean() -> None:
    one = replace(pictures(1), mean_residual="")
    assert "mean over the photographs" not in words(page(clay(), names(1), one))
    assert "mean over the photographs" in words(page(clay(), names(2), pictures(2)))
    assert "mean over the photographs" not in words(page(clay(), names(2), None))
