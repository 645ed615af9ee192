"""The MERL writer: read back by the reader, and by a look-up of another hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from matest.brdf import CookTorrance, Lambert, LiTorrance, OrenNayarSingleSlope, Ward
from matest.errors import InputError
from matest.estimation.table_fit import fit_table
from matest.export import merl
from matest.export.conversion import Conversion
from matest.tables import load_table
from tests.estimation.test_table_fit import in_standard_errors

GLOSS = CookTorrance([0.3, 0.2, 0.1], [0.9, 0.8, 0.7], 0.3)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Conversion]:
    path = tmp_path_factory.mktemp("merl") / "gloss.binary"
    return path, merl.write(GLOSS, path)


def looked_up(path: Path, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """f [3] as the database's own reader looks it up: the difference angle by turning the light, not by a formula."""
    theta_h, phi_h = angles((wi + wo) / np.linalg.norm(wi + wo))
    about_normal = np.array([[math.cos(phi_h), math.sin(phi_h), 0], [-math.sin(phi_h), math.cos(phi_h), 0], [0, 0, 1]])
    about_bitangent = np.array(
        [[math.cos(theta_h), 0, -math.sin(theta_h)], [0, 1, 0], [math.sin(theta_h), 0, math.cos(theta_h)]]
    )
    theta_d, phi_d = angles(about_bitangent @ about_normal @ wi)
    phi_d += math.pi if phi_d < 0 else 0
    i = min(int(math.sqrt(theta_h / (math.pi / 2) * 90 * 90)), 89)
    j, k = min(int(theta_d / (math.pi / 2) * 90), 89), min(int(phi_d / math.pi * 180), 179)
    place = k + j * 180 + i * 180 * 90
    stored = np.memmap(path, "<f8", "r", offset=12)
    return stored[place :: 90 * 90 * 180] * np.array([1.00 / 1500, 1.15 / 1500, 1.66 / 1500])


def angles(vector: np.ndarray) -> tuple[float, float]:
    return math.acos(min(vector[2], 1.0)), math.atan2(vector[1], vector[0])


def test_an_independent_look_up_gives_the_material(written: tuple[Path, Conversion]) -> None:
    generator = np.random.default_rng(1)
    vectors = generator.normal(size=(2, 300, 3))
    vectors[..., 2] = np.abs(vectors[..., 2]) + 0.3
    wi, wo = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    table = np.array([looked_up(written[0], *pair) for pair in zip(wi, wo, strict=True)])
    truth = GLOSS(torch.from_numpy(wi), torch.from_numpy(wo)).numpy()
    relative = np.abs(table / truth - 1)
    # Within a cell the lobe rises by some per cent.
    assert np.median(relative) < 0.01
    assert relative.max() < 0.2
    # To either side alike: an entry is f in the middle of its cell.
    assert abs((table / truth - 1).mean()) < 0.003


def test_the_reader_gives_the_material_at_every_cell(written: tuple[Path, Conversion]) -> None:
    table = load_table(written[0])
    assert table.skipped["not measured"] == 0
    torch.testing.assert_close(table.values, GLOSS(table.wi, table.wo), rtol=1e-9, atol=1e-12)


def test_the_measured_error_of_the_conversion_is_that_of_looking_up(
    written: tuple[Path, Conversion],
) -> None:
    assert 0.001 < written[1].error.relative_rmse < 0.1
    assert written[1].error.median < 0.01


def test_what_was_written_is_estimated_again(written: tuple[Path, Conversion]) -> None:
    fit = fit_table(load_table(written[0]), "cook-torrance", noise=0.01, fix={"f0": 0.04})
    # Entries have no noise: errors are far within the stated one.
    assert max(abs(error) for each in in_standard_errors(fit, GLOSS).values() for error in each) < 0.1
    assert len(fit.incidences) == 9


def test_the_normal_itself_can_be_looked_up(written: tuple[Path, Conversion]) -> None:
    normal = np.array([0.0, 0.0, 1.0])
    truth = GLOSS(torch.tensor([[0.0, 0, 1]], dtype=torch.float64), torch.tensor([[0.0, 0, 1]], dtype=torch.float64))
    assert looked_up(written[0], normal, normal) == pytest.approx(truth[0].numpy(), rel=0.01)


def test_a_grey_material_fills_all_channels(tmp_path: Path) -> None:
    error = merl.write(Lambert(0.5), tmp_path / "grey.binary").error
    assert error.relative_rmse == pytest.approx(0, abs=1e-12)
    values = load_table(tmp_path / "grey.binary").values
    torch.testing.assert_close(values, torch.full_like(values, 0.5 / math.pi))


def test_materials_that_are_not_reciprocal_are_averaged_and_the_error_says_so(tmp_path: Path) -> None:
    options = {"directional": "off", "subsurface": "off", "forward": "on"}
    forward = LiTorrance(k_fs=2.0, height_rms=0.5, correlation_length=2.5, **options)
    assert merl.write(forward, tmp_path / "a.binary").error.relative_rmse > 0.1


def test_what_the_format_cannot_hold_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.binary"
    for material in (Ward(0.1, 0.5, slope_x=0.1, slope_y=0.4, anisotropy="axes"), OrenNayarSingleSlope(0.5, 0.6, 0.3)):
        with pytest.raises(InputError, match=r"a.binary: a MERL table holds isotropic materials"):
            merl.write(material, path)
    with pytest.raises(InputError, match=r"has the channels R, G, B, and the material has 5"):
        merl.write(Lambert([0.1, 0.2, 0.3, 0.4, 0.5]), path)
    assert not path.exists()
