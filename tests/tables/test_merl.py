"""MERL's `.binary`, written here by a loop over the cells."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from matest.errors import InputError
from matest.tables import Declaration, load_table
from matest.tables.merl import cells

N = 90 * 90 * 180
SCALES = (1 / 1500, 1.15 / 1500, 1.66 / 1500)


def write(path: Path, stored: np.ndarray, shape: tuple[int, int, int] = (90, 90, 180)) -> Path:
    with path.open("wb") as file:
        np.array(shape, "<i4").tofile(file)
        stored.astype("<f8").tofile(file)
    return path


def place(i: int, j: int, k: int) -> int:
    return k + 180 * (j + 90 * i)


def angles(i: int, j: int, k: int) -> tuple[float, float, float]:
    """θh, θd, φd at the middle of a cell, as the readers of the database invert their look-up."""
    return (i + 0.5) ** 2 / 90**2 * math.pi / 2, (j + 0.5) / 90 * math.pi / 2, (k + 0.5) / 180 * math.pi


def directions(theta_h: float, theta_d: float, phi_d: float) -> tuple[np.ndarray, np.ndarray]:
    """Light and viewer: the difference vector in the frame of the half vector, and its mirror image."""
    half = np.array([math.sin(theta_h), 0.0, math.cos(theta_h)])
    tangent, bitangent = np.array([math.cos(theta_h), 0.0, -math.sin(theta_h)]), np.array([0.0, 1.0, 0.0])
    across = math.sin(theta_d) * (math.cos(phi_d) * tangent + math.sin(phi_d) * bitangent)
    return math.cos(theta_d) * half + across, math.cos(theta_d) * half - across


def test_cells_are_at_the_published_coordinates() -> None:
    wi, wo, _ = cells()
    generator = np.random.default_rng(0)
    for i, j, k in [(0, 0, 0), (89, 89, 179), *generator.integers(0, (90, 90, 180), (50, 3))]:
        light, viewer = directions(*angles(i, j, k))
        assert wi[place(i, j, k)].tolist() == pytest.approx(light, abs=1e-12)
        assert wo[place(i, j, k)].tolist() == pytest.approx(viewer, abs=1e-12)


def test_solid_angles_add_up_to_the_hemispheres_of_half_and_difference() -> None:
    measure = cells()[2]
    # ∫ sin θh dθh = 1 and ∫ sin θd cos θd dθd = 1/2, for each of the azimuths.
    assert float(measure.sum()) == pytest.approx(0.5 * 180 * 90 / (math.pi / 2), rel=1e-3)


def test_values_are_scaled_and_nothing_else(tmp_path: Path) -> None:
    stored = np.full((3, N), -1.0)
    cell = place(10, 20, 30)
    stored[:, cell] = 1500.0, 3000.0, 750.0
    table = load_table(write(tmp_path / "a.binary", stored))
    assert table.values.tolist() == [pytest.approx([1.0, 2 * 1.15, 0.5 * 1.66])]
    light, viewer = directions(*angles(10, 20, 30))
    assert table.wi[0].tolist() == pytest.approx(light)
    assert table.wo[0].tolist() == pytest.approx(viewer)


def test_an_entry_is_invalid_if_any_channel_is(tmp_path: Path) -> None:
    stored = np.full((3, N), 2.0)
    for channel, cell in enumerate([place(0, 0, 0), place(3, 4, 5), place(6, 7, 8)]):
        stored[channel, cell] = -1
    stored[0, place(9, 9, 9)] = np.nan
    table = load_table(write(tmp_path / "a.binary", stored))
    assert table.skipped["not measured"] == 4
    assert bool((table.values > 0).all())
    assert bool((table.wi[:, 2] > 0).all())
    assert bool((table.wo[:, 2] > 0).all())
    assert len(table) == N - 4 - table.skipped["below the horizon"]
    assert table.measure is not None
    assert float(table.measure.mean()) == pytest.approx(1)


def test_at_the_normal_everything_is_finite(tmp_path: Path) -> None:
    stored = np.full((3, N), -1.0)
    stored[:, place(0, 0, 0)] = 1500
    table = load_table(write(tmp_path / "a.binary", stored))
    assert bool(torch.isfinite(table.wi).all())
    assert float(table.wi[0, 2]) > math.cos(math.radians(1))


@pytest.mark.parametrize(
    ("declaration", "words"),
    [
        (Declaration(units="deg"), "--units says how to read a CSV table"),
        (Declaration(quantity="f"), "--quantity says how to read a CSV table"),
        (Declaration(channels="450"), "--channels 450 needs a table of wavelengths, and its channels are R, G, B"),
    ],
)
def test_what_the_format_has_no_choice_of_is_refused(tmp_path: Path, declaration: Declaration, words: str) -> None:
    with pytest.raises(InputError, match=f"a.binary: {words}"):
        load_table(write(tmp_path / "a.binary", np.full((3, N), 150.0)), declaration)


def test_another_resolution_or_length_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"header says 90 × 90 × 360 in"):
        load_table(write(tmp_path / "a.binary", np.zeros((3, N)), (90, 90, 360)))
    with pytest.raises(InputError, match=r"expected a MERL table of 90 × 90 × 180 cells in 34,992,012 bytes"):
        load_table(write(tmp_path / "b.binary", np.zeros((3, 10))))
    with pytest.raises(InputError, match="every entry is marked as invalid"):
        load_table(write(tmp_path / "c.binary", np.full((3, N), -1.0)))
