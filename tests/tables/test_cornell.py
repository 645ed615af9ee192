"""Cornell's `.brdf`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from matest.errors import InputError
from matest.spectra import to_rgb
from matest.tables import Declaration, load_table
from tests.captures import refusal
from tests.shared_data import measurement

TABLE = """# a surface
3
400 500
600  # nm
# theta i, phi i, theta s, phi_s, values
0.5 0.0 0.3 3.14159265358979 0.1 0.2 0.3
0.5 0.0 0.4 0.0   0.1 0.0 -0.001
0.5 0.0 1.7 0.0   0.1 0.2 0.3
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "surface.brdf"
    path.write_text(TABLE)
    return path


def test_every_wavelength_is_a_channel(path: Path) -> None:
    table = load_table(path)
    assert table.channels == ["400 nm", "500 nm", "600 nm"]
    assert table.wavelengths is not None
    assert table.wavelengths.tolist() == [0.4, 0.5, 0.6]
    # Values that are not positive are measurements; a viewer below the horizon is not.
    assert table.values.tolist() == [[0.1, 0.2, 0.3], [0.1, 0.0, -0.001]]
    assert table.skipped["below the horizon"] == 1
    assert table.notes == ["2 of 6 values are not positive; they count as measurements of what is dark."]
    light, viewer = table.wi[0].tolist(), table.wo[0].tolist()
    assert light == pytest.approx([math.sin(0.5), 0, math.cos(0.5)])
    # The azimuth π is the mirror's side.
    assert viewer == pytest.approx([-math.sin(0.3), 0, math.cos(0.3)])


def test_rgb_is_by_the_matching_functions(path: Path) -> None:
    table = load_table(path, Declaration(channels="rgb"))
    wavelengths = torch.tensor([0.4, 0.5, 0.6], dtype=torch.float64)
    spectra = torch.tensor([[0.1, 0.2, 0.3], [0.1, 0.0, -0.001]], dtype=torch.float64)
    torch.testing.assert_close(table.values, to_rgb(spectra, wavelengths))
    assert table.channels == ["R", "G", "B"]
    assert table.wavelengths is None


def test_single_wavelengths_can_be_asked_for(path: Path) -> None:
    assert load_table(path, Declaration(channels="500")).values.tolist() == [[0.2], [0.0]]


def test_azimuths_are_not_to_be_declared(path: Path) -> None:
    with pytest.raises(InputError, match="--azimuth says how to read a CSV table, and this format leaves no choice"):
        load_table(path, Declaration(azimuth="retro"))


def test_an_incomplete_file_is_refused(path: Path) -> None:
    path.write_text(TABLE.rsplit(" ", 1)[0])
    with pytest.raises(InputError, match="do not divide into such rows; is the file complete"):
        load_table(path)


@pytest.mark.parametrize(("name", "dark"), [("krylon_blue", 1_218), ("acryl_blue", 18_901)])
def test_measured_enamels_are_read_whole(name: str, dark: int) -> None:
    table = load_table(measurement("cornell", f"{name}.brdf"))
    assert table.values.shape == (1_439, 31)
    assert int((table.values <= 0).sum()) == dark
    # The highlight lies on the mirror's side.
    brightest = int(table.values.mean(1).argmax())
    half = table.wi[brightest] + table.wo[brightest]
    assert float(half[2] / half.norm()) > np.cos(np.radians(3))


@pytest.mark.parametrize("count", ["nan", "inf", "-inf", "1e300", "-3", "2.5"])
def test_a_count_that_is_none_is_refused(tmp_path: Path, count: str) -> None:
    (tmp_path / "a.brdf").write_text(f"{count}\n450 550\n0.1 0 0.2 0 0.3 0.4\n")
    assert "the number of wavelengths" in refusal(lambda: load_table(tmp_path / "a.brdf"))
