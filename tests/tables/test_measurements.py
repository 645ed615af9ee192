"""Tables of single measurements: what they give, what they declare, what is refused."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import pytest
import torch

from matest.errors import InputError
from matest.estimation.table_fit import fit_table
from matest.tables import Declaration, load_table
from tests.tables.dome import ALBEDO, BLACK, HEAD, SATURATION, Dome, fujii

GOOD = Dome(lights=4, pixels=8)


@pytest.mark.parametrize("power", [1.0, 3.0])
def test_a_matte_ball_has_one_reflectance_everywhere(tmp_path: Path, power: float) -> None:
    declared = {"transfer": "linear", "black": BLACK, "anisotropy": power}
    table = load_table(Dome(power=power, declared=declared).write(tmp_path / "dome.csv"))
    assert table.relative
    assert list(table.channels) == ["R", "G", "B"]
    shares = table.values / table.values[:, :1]
    expected = torch.tensor([[albedo / ALBEDO["R"] for albedo in ALBEDO.values()]], dtype=torch.float64)
    torch.testing.assert_close(shares, expected.expand_as(shares), rtol=1e-5, atol=0)
    torch.testing.assert_close(table.values, table.values[:1].expand_as(table.values), rtol=1e-5, atol=0)
    assert "60 pixels under 12 lights, which are equally strong and radiate by the power" in table.notes[0]
    assert table.notes[0].endswith(f"beyond {BLACK:g}.")
    # Points of the ball that face away from a light were measured in the dark.
    assert len(table) + table.skipped["below the horizon"] == 60 * 12


def test_absolute_codes_are_reflectances_in_1_per_sr(tmp_path: Path) -> None:
    declared = {"transfer": "linear", "black": 0, "radiometry": "absolute"}
    dome = Dome(declared=declared, scale=1.0, exposures=(0.5,), lights=5)
    # Codes of the writer stand on a black level: as radiances they have none, and many digits.
    rows = []
    for row in dome.rows():
        pixel, channel, _, exposure, *rest = row.split(",")
        place, inward, point, normal = (
            torch.tensor([float(x) for x in rest[k : k + 3]]).double() for k in (0, 3, 6, 9)
        )
        offset = place - point
        distance = offset.norm()
        cosines = (offset @ normal / distance / 2).clamp(min=0) * (-(offset @ inward) / distance).clamp(min=0)
        code = 0.5 * ALBEDO[channel] / math.pi * float(7 * cosines / distance**2)
        rows.append(f"{pixel},{channel},{code:.12g},{exposure},{','.join(rest)},7")
    comments = "".join(f"# {key}: {value}\n" for key, value in declared.items())
    (tmp_path / "dome.csv").write_text(f"{comments}{HEAD},intensity\n" + "\n".join(rows))
    table = load_table(tmp_path / "dome.csv")
    assert not table.relative
    expected = torch.tensor([[albedo / math.pi for albedo in ALBEDO.values()]], dtype=torch.float64)
    torch.testing.assert_close(table.values, expected.expand_as(table.values), rtol=1e-5, atol=0)


def test_exposures_of_one_pixel_become_one_value_without_the_saturated_ones(tmp_path: Path) -> None:
    declared = {"transfer": "linear", "black": BLACK, "saturation": SATURATION}
    once = load_table(Dome(declared=declared, scale=1e9).write(tmp_path / "once.csv"))
    thrice = load_table(Dome(declared=declared, scale=1e9, exposures=(0.1, 1.0, 20.0)).write(tmp_path / "thrice.csv"))
    assert once.skipped["saturated"] == 0
    assert thrice.skipped["saturated"] > 100
    torch.testing.assert_close(thrice.wi, once.wi)
    torch.testing.assert_close(thrice.values, once.values, rtol=1e-4, atol=0)


def test_codes_that_pile_up_are_saturated_though_nothing_says_so(tmp_path: Path) -> None:
    declared = {"transfer": "linear", "black": BLACK}
    clipped = load_table(Dome(declared=declared, scale=1e9, exposures=(1.0, 20.0)).write(tmp_path / "a.csv"))
    stated = declared | {"saturation": SATURATION}
    told = load_table(Dome(declared=stated, scale=1e9, exposures=(1.0, 20.0)).write(tmp_path / "b.csv"))
    assert clipped.skipped == told.skipped
    torch.testing.assert_close(clipped.values, told.values)
    assert clipped.notes[0].endswith("beyond 64, and 4000, where they pile up, is saturated.")


def test_headings_of_a_laboratory_are_declared_in_comments(tmp_path: Path) -> None:
    text = GOOD.text()
    plain = load_table(GOOD.write(tmp_path / "a.csv"))
    other = text.replace("code", "DN").replace("light_x", "Lx")
    (tmp_path / "b.csv").write_text("# code: DN\n# light_x = Lx\n# free: of any form\n" + other)
    torch.testing.assert_close(load_table(tmp_path / "b.csv").values, plain.values)


def test_roughness_of_a_measured_ball_is_estimated_within_its_error_bar(tmp_path: Path) -> None:
    dome = Dome(reflectance=partial(fujii, sigma=0.5), noise=8.0, exposures=(0.5, 1.0))
    fit = fit_table(load_table(dome.write(tmp_path / "dome.csv")), "fujii")
    sigma = fit.estimate.parameters["sigma"]
    assert 0 < sigma.std < 0.02
    assert abs(sigma.value - 0.5) < 4 * sigma.std + 0.01
    albedo = torch.tensor(fit.estimate.parameters["albedo"].value)
    torch.testing.assert_close(albedo / albedo[0], torch.tensor([1.0, 2 / 3, 1 / 3]), rtol=0.02, atol=0)
    assert fit.estimate.relative


def spoilt(old: str, new: str) -> str:
    """The text of a good table with one thing wrong."""
    text = GOOD.text()
    assert old in text
    return text.replace(old, new, 1)


BAD = {
    "transfer": (
        spoilt("# transfer: linear\n", ""),
        "nothing says that codes are proportional to light; if they are, add the line '# transfer: linear', and "
        "convert them if not.",
    ),
    "gamma": (spoilt("transfer: linear", "transfer: srgb"), "line 1: transfer must be linear; got 'srgb'."),
    "black": (spoilt("black: 64.0", "black: dark"), "line 2: black must be a number from 0 on; got 'dark'."),
    "slip": (spoilt("# black", "# blak"), "line 2: 'blak' declares nothing; did you mean 'black'? Correct it."),
    "heading": (
        "# normal_x: Nx\n" + GOOD.text(),
        "line 1: normal_x is the column 'Nx', and there is none; known are pixel, channel",
    ),
    "column": (
        spoilt("viewer_z", "z"),
        "expected the column viewer_z of a table of measurements, and its columns are pixel, channel",
    ),
    "cells": (spoilt("p0,R,", "p0,R,1,"), "expected 19 numbers in line 4, and it reads 'p0,R,1,"),
    "text": (spoilt(",1.0,", ",long,"), "expected 1 numbers in line 4, and it reads 'p0,R,"),
    "exposure": (spoilt(",1.0,", ",0,"), "line 4: exposure must be positive; correct it."),
    "saturation": (
        "# saturation: 1\n" + GOOD.text(),
        "expected rows with numbers and without saturation below the names of the columns, and there are none.",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_malformed_measurements_are_refused_in_a_sentence(name: str, tmp_path: Path) -> None:
    text, sentence = BAD[name]
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError) as error:
        load_table(tmp_path / "bad.csv")
    assert str(error.value).startswith(f"{tmp_path / 'bad.csv'}: {sentence}")


@pytest.mark.parametrize("name", ["normal", "light_normal"])
def test_directions_of_no_length_are_refused(tmp_path: Path, name: str) -> None:
    rows = [row.split(",") for row in GOOD.rows()]
    start = HEAD.split(",").index(f"{name}_x")
    rows[5][start : start + 3] = ["0"] * 3
    text = "\n".join(["# transfer: linear", HEAD, *(",".join(row) for row in rows)])
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError, match=f"line 8: {name} is 0 0 0"):
        load_table(tmp_path / "bad.csv")


def test_readings_of_other_tables_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--units says how to read a CSV table, and this format leaves no choice"):
        load_table(GOOD.write(tmp_path / "a.csv"), Declaration(units="deg"))
