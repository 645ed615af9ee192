"""CSV tables: every reading of them, what they declare, what is refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import torch

from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar
from matest.errors import InputError
from matest.spectra import to_rgb
from matest.tables import Declaration, load_table
from tests.tables.goniometer import hemispherical, measured, write_csv

GLOSS = CookTorrance(0.3, 1.0, 0.15)
PLAIN = Declaration(azimuth="retro", quantity="f")


@pytest.mark.parametrize("degrees", [False, True])
@pytest.mark.parametrize("forward", [False, True])
def test_units_and_azimuth_are_seen(tmp_path: Path, degrees: bool, forward: bool) -> None:
    table = measured(GLOSS, hemispherical())
    path = write_csv(table, tmp_path / "a.csv", degrees=degrees, forward=forward)
    read = load_table(path, Declaration(quantity="f"))
    # The frame may be turned about the normal; angles between directions are what they were.
    torch.testing.assert_close((read.wi * read.wo).sum(-1), (table.wi * table.wo).sum(-1), atol=1e-7, rtol=0)
    torch.testing.assert_close(read.values, table.values, atol=1e-7, rtol=1e-7)
    words = f"angles in {'deg' if degrees else 'rad'}, azimuth {'forward' if forward else 'retro'}"
    assert words in read.notes[0]


@pytest.mark.parametrize("scale", ["f", "pi-f", "f-cos"])
def test_declared_quantities_become_f(tmp_path: Path, scale: str) -> None:
    table = measured(GLOSS, hemispherical())
    path = write_csv(table, tmp_path / "a.csv", scale=scale)
    declaration = Declaration(azimuth="retro", quantity=scale)  # type: ignore[arg-type]
    torch.testing.assert_close(load_table(path, declaration).values, table.values, rtol=1e-6, atol=1e-9)


def test_a_file_declares_its_reading(tmp_path: Path) -> None:
    path = write_csv(measured(Lambert(0.5), hemispherical()), tmp_path / "a.csv", degrees=True)
    path.write_text("# units: deg\n# azimuth = forward\n# quantity: pi-f\n" + path.read_text())
    table = load_table(path)
    assert table.notes == ["Read with angles in deg, azimuth forward, quantity pi-f."]
    assert float(table.values.mean()) == pytest.approx(0.5 / torch.pi**2, rel=0.01)
    # An option comes first.
    assert float(load_table(path, Declaration(quantity="f")).values.mean()) == pytest.approx(0.5 / torch.pi, rel=0.01)


def test_wavelengths_and_repeated_names_of_columns(tmp_path: Path) -> None:
    rows = "\n0.5,0,0.3,1,0.1,0.2\n"
    path = tmp_path / "a.csv"
    path.write_text("theta_i,phi_i,theta_r,phi_r,450 nm,550nm" + rows)
    table = load_table(path, PLAIN)
    assert table.wavelengths is not None
    assert table.wavelengths.tolist() == [0.45, 0.55]
    path.write_text("theta_i,phi_i,theta_r,phi_r,value,value" + rows)
    assert load_table(path, PLAIN).channels == ["value 0", "value 1"]


def test_negative_polar_angles_lie_beyond_the_normal(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("theta_i,phi_i,theta_r,phi_r,value\n30,0,-30,0,0.1\n30,0,30,180,0.1\n")
    table = load_table(path, Declaration(units="deg", azimuth="retro", quantity="f"))
    torch.testing.assert_close(table.wo[0], table.wo[1])


def test_rows_below_the_horizon_and_gaps_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("theta_i,phi_i,theta_r,phi_r,value\n30,0,30,180,0.1\n30,0,95,180,0.1\n30,0,40,180,\n")
    table = load_table(path, Declaration(units="deg", azimuth="retro", quantity="f"))
    assert len(table) == 1
    assert table.skipped == {"not a number": 1, "below the horizon": 1}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b,c,d,e\n1,2,3,4,5\n", "expected the columns theta_i,phi_i,theta_r,phi_r"),
        ("# a\ntheta_i;phi_i;theta_r;phi_r;value\n", "line 2 has semicolons between the columns; save it with commas"),
        ("theta_i\tphi_i\ttheta_r\tphi_r\tvalue\n", "line 1 has tabs between the columns"),
        ("theta_i,phi_i,theta_r,phi_r,value\n0.1,0,0.2,bright,1\n", "expected 5 numbers in line 2"),
        ("theta_i,phi_i,theta_r,phi_r,value\n0.1,0,0.2\n", "expected 5 numbers in line 2"),
        ("theta_i,phi_i,theta_r,phi_r,value\n", "there are none"),
        ("theta_i,phi_i,theta_r,phi_r,value\n0.5,0,0.6,180,1\n", "as if in different units"),
        (
            "# units: rad\ntheta_i,phi_i,theta_r,phi_r,value\n1,0,1,180,1\n1,0,60,180,1\n",
            "Declared are radians, but polar angles reach 60, as if in degrees, and such angles do not tell the rest",
        ),
        ("# units: furlong\n", "line 1: units must be one of rad, deg; got 'furlong'"),
        ("\n# azimuth = toward the light\n", "line 2: azimuth must be one of retro, forward"),
        ("# azimut: retro\n", "line 1: 'azimut' declares nothing; did you mean 'azimuth'"),
        ("# Unit: rad\n", "line 1: 'Unit' declares nothing; did you mean 'units'"),
    ],
)
def test_bad_tables_are_refused_in_a_sentence(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=f"bad.csv: .*{words}"):
        load_table(path)


def test_other_comments_are_free(tmp_path: Path) -> None:
    path = write_csv(measured(GLOSS, hemispherical()), tmp_path / "a.csv")
    free = "# quality: good\n# sample = 7\n# the units: none of them matter\n# Azimuth: Retro\n"
    path.write_text(free + path.read_text())
    assert "azimuth retro" in load_table(path, Declaration(quantity="f")).notes[0]


@pytest.mark.parametrize(
    ("content", "declared", "words"),
    [
        (
            {},
            Declaration(azimuth="forward", quantity="f"),
            "azimuth forward, but the highlight lies where retro has it",
        ),
        ({"forward": True}, Declaration(azimuth="retro", quantity="f"), "azimuth retro, but .* where forward has it"),
        (
            {},
            Declaration(azimuth="retro", quantity="f-cos"),
            "f-cos, but exchanged directions differ unless .* f or pi-f",
        ),
        ({"scale": "f-cos"}, Declaration(azimuth="retro", quantity="f"), "quantity f, but exchanged .* it is f-cos"),
        ({}, Declaration("deg", "retro", "f"), "degrees, but polar angles reach 1.48 only, as if in radians"),
    ],
)
def test_a_declaration_that_the_values_contradict_is_followed_and_doubted(
    tmp_path: Path, content: dict[str, Any], declared: Declaration, words: str
) -> None:
    table = load_table(write_csv(measured(GLOSS, hemispherical()), tmp_path / "a.csv", **content), declared)
    assert f"quantity {declared.quantity}." in table.notes[0]
    assert re.match(f"Declared (is|are) .*{words}.*: check what is declared; it was followed", table.notes[1])
    assert len(table.notes) == 2


@pytest.mark.parametrize("material", [GLOSS, Lambert(0.5), OrenNayar(0.7, 0.6)])
def test_a_right_declaration_is_not_doubted(tmp_path: Path, material: Brdf) -> None:
    path = write_csv(measured(material, hemispherical()), tmp_path / "a.csv")
    assert len(load_table(path, PLAIN).notes) == 1


def test_channels_of_a_table_of_wavelengths_are_chosen_and_made_rgb(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("theta_i,phi_i,theta_r,phi_r,650 nm,550 nm,450 nm\n0.5,0,0.3,1,0.3,0.2,0.1\n")
    blue = load_table(path, Declaration("rad", "retro", "f", channels="450"))
    assert (blue.channels, blue.values.tolist()) == (["450 nm"], [[0.1]])
    rgb = load_table(path, Declaration("rad", "retro", "f", channels="rgb"))
    assert rgb.channels == ["R", "G", "B"]
    spectrum, ascending = torch.tensor([[0.1, 0.2, 0.3], [0.45, 0.55, 0.65]], dtype=torch.float64)
    torch.testing.assert_close(rgb.values[0], to_rgb(spectrum, ascending))
    with pytest.raises(InputError, match=r"a\.csv: expected the wavelength 500 nm"):
        load_table(path, Declaration("rad", "retro", "f", channels="500"))


@pytest.mark.parametrize("channels", ["rgb", "450"])
def test_channels_of_a_table_without_wavelengths_are_refused(tmp_path: Path, channels: str) -> None:
    path = write_csv(measured(GLOSS, hemispherical()), tmp_path / "a.csv")
    with pytest.raises(InputError, match=f"a.csv: --channels {channels} needs a table of wavelengths"):
        load_table(path, Declaration("rad", "retro", "f", channels=channels))


def test_columns_that_are_rgb_already_can_be_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("theta_i,phi_i,theta_r,phi_r,r,g,b\n0.5,0,0.3,1,0.3,0.2,0.1\n")
    assert load_table(path, Declaration("rad", "retro", "f", channels="rgb")).values.tolist() == [[0.3, 0.2, 0.1]]


def test_matte_tables_do_not_tell_the_side_of_the_azimuth(tmp_path: Path) -> None:
    for material in (Lambert(0.5), OrenNayar(0.7, 0.6)):
        for forward in (False, True):
            path = write_csv(measured(material, hemispherical()), tmp_path / "a.csv", forward=forward)
            with pytest.raises(InputError, match="both readings fit alike; declare --azimuth"):
                load_table(path, Declaration(quantity="f"))


def test_a_row_with_an_immense_number_is_left_out(tmp_path: Path) -> None:
    rows = [f"{i},0,{r},0,{0.3 + 0.1 * i}" for i in (0.1, 0.5, 0.9) for r in (0.2, 0.6)]
    head = "# units: rad\n# azimuth: retro\n# quantity: f\ntheta_i,phi_i,theta_r,phi_r,f\n"
    (tmp_path / "a.csv").write_text(head + "\n".join([*rows, "0.3,0,0.4,0,1e300"]) + "\n")
    table = load_table(tmp_path / "a.csv")
    assert len(table) == len(rows)
    assert table.skipped["not a number"] == 1
