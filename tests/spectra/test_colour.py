"""From spectra to linear RGB."""

from __future__ import annotations

import subprocess
import sys

import colour
import numpy as np
import pytest
import torch
from torch import Tensor

from matest.errors import InputError
from matest.spectra import VISIBLE, desaturate, illuminant, luminance, to_rgb
from tests import tolerances

# The printed matrix of sRGB and its printed inverse have four decimals.
FOUR_DECIMALS = 1e-4
# Smooth spectrum, 5 nm against 1 nm.
QUADRATURE = 1e-3


@pytest.fixture
def spectra(rng: np.random.Generator) -> Tensor:
    """Reflectances [6, Λ], smooth, within [0, 1]."""
    phases, periods = rng.uniform(0, 6, (6, 1)), rng.uniform(0.1, 0.5, (6, 1))
    return 0.5 + 0.5 * torch.sin(torch.from_numpy(phases) + 2 * torch.pi * VISIBLE / torch.from_numpy(periods))


@pytest.fixture
def outside(rng: np.random.Generator) -> Tensor:
    """Colours [500, 3] of positive luminance with one or two negative channels."""
    rgb = torch.from_numpy(rng.uniform(-1, 2, (4000, 3)))
    return rgb[(luminance(rgb)[:, 0] > 0.01) & (rgb < 0).any(-1)][:500]


def in_colour_science(spectrum: Tensor, name: str) -> np.ndarray:
    shape = colour.SpectralShape(360, 780, 5)
    xyz = colour.sd_to_XYZ(
        colour.SpectralDistribution(spectrum.numpy(), shape.wavelengths),
        colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape),
        colour.SDS_ILLUMINANTS[name].copy().align(shape),
        method="Integration",
    )
    return colour.XYZ_to_sRGB(xyz / 100, apply_cctf_encoding=False)


def xyz_of(rgb: Tensor) -> Tensor:
    return rgb @ rgb.new_tensor(colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ).T


def chromaticity(rgb: Tensor) -> Tensor:
    """(x, y) [..., 2]."""
    xyz = xyz_of(rgb)
    return xyz[..., :2] / xyz.sum(-1, keepdim=True)


@pytest.mark.parametrize("name", ["D65", "A", "E"])
def test_rgb_is_that_of_colour_science(spectra: Tensor, name: str) -> None:
    expected = np.stack([in_colour_science(spectrum, name) for spectrum in spectra])
    np.testing.assert_allclose(to_rgb(spectra, illuminant=name), expected, rtol=0, atol=tolerances.INDEPENDENT)


def test_white_is_neutral_in_daylight() -> None:
    white = to_rgb(torch.ones_like(VISIBLE))
    assert white.tolist() == pytest.approx([1, 1, 1], abs=FOUR_DECIMALS)


@pytest.mark.parametrize("name", ["A", "D50", "E"])
def test_white_under_another_light_is_tinted_with_unit_luminance(name: str) -> None:
    white = to_rgb(torch.ones_like(VISIBLE), illuminant=name)
    assert white.max() - white.min() > 0.1
    assert luminance(white).item() == pytest.approx(1, abs=FOUR_DECIMALS)


def test_wavelengths_count_by_the_width_they_stand_for() -> None:
    unequal = torch.cat([torch.arange(0.36, 0.5495, 0.001), torch.arange(0.55, 0.7805, 0.005)]).double()

    def spectrum(at: Tensor) -> Tensor:
        return 0.5 + 0.4 * torch.sin(20 * at)

    expected = to_rgb(spectrum(VISIBLE)).tolist()
    assert to_rgb(spectrum(unequal), unequal).tolist() == pytest.approx(expected, abs=QUADRATURE)


def test_ultraviolet_is_invisible(spectra: Tensor) -> None:
    wider = torch.linspace(0.3, 0.78, 97, dtype=torch.float64)
    padded = torch.cat([torch.ones(len(spectra), 12), spectra], dim=-1)
    torch.testing.assert_close(to_rgb(padded, wider), to_rgb(spectra), rtol=0, atol=tolerances.INDEPENDENT)


def test_single_precision_in_single_precision_out(spectra: Tensor) -> None:
    rgb = to_rgb(spectra.float(), VISIBLE.float())
    torch.testing.assert_close(rgb, to_rgb(spectra).float(), rtol=0, atol=tolerances.FLOAT32)


def test_colour_is_differentiable(spectra: Tensor) -> None:
    assert torch.autograd.gradcheck(to_rgb, spectra[:2].requires_grad_())


def test_illuminant_is_tabulated_and_linear_in_between() -> None:
    table = colour.SDS_ILLUMINANTS["D65"]
    power = illuminant("D65", torch.tensor([0.4, 0.4025, 0.405, 0.56], dtype=torch.float64))
    low, high = table[400], table[405]
    assert power.tolist() == pytest.approx([low, (low + high) / 2, high, 100], rel=tolerances.INDEPENDENT)


def test_unknown_illuminant_names_the_nearest() -> None:
    with pytest.raises(InputError, match=r"'D66'; did you mean 'D65'\?"):
        to_rgb(torch.ones_like(VISIBLE), illuminant="D66")


@pytest.mark.parametrize("at", [[0.5, 0.9], [0.2, 0.5], [360.0, 780.0]])
def test_wavelengths_beyond_the_illuminant_are_refused(at: list[float]) -> None:
    with pytest.raises(InputError, match=rf"from 0\.3 to 0\.78 µm, but wavelengths from {at[0]:g} to {at[1]:g} came"):
        to_rgb(torch.ones(2), torch.tensor(at))


def test_fluorescent_lamps_begin_at_380_nanometres(spectra: Tensor) -> None:
    with pytest.raises(InputError, match=r"FL2 is tabulated from 0\.38 "):
        to_rgb(spectra, illuminant="FL2")
    assert to_rgb(spectra[:, 4:], VISIBLE[4:], "FL2").isfinite().all()


@pytest.mark.parametrize("at", [[0.5], [0.6, 0.5], [0.5, 0.5]])
def test_wavelengths_must_increase(at: list[float]) -> None:
    with pytest.raises(InputError, match="each above the one before"):
        to_rgb(torch.ones(len(at)), torch.tensor(at))


def test_desaturation_keeps_luminance(outside: Tensor) -> None:
    torch.testing.assert_close(
        luminance(desaturate(outside)), luminance(outside), rtol=tolerances.INDEPENDENT, atol=tolerances.INDEPENDENT
    )


def test_desaturation_keeps_dominant_wavelength(outside: Tensor) -> None:
    """The chromaticity moves on the line to white, and not past it."""
    white = chromaticity(torch.ones(3, dtype=torch.float64))
    # (x, y) has a pole outside the gamut, where x + y + z changes sign.
    outside = outside[xyz_of(outside).sum(-1) > 0.1]
    before, after = chromaticity(outside) - white, chromaticity(desaturate(outside)) - white
    across = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    assert len(outside) > 100
    assert across.abs().max() < tolerances.INDEPENDENT
    assert ((before * after).sum(-1) > 0).all()


def test_desaturation_is_the_least_that_reaches_the_gamut(outside: Tensor) -> None:
    lowest = desaturate(outside).amin(-1)
    assert (lowest >= 0).all()
    assert lowest.max() < tolerances.INDEPENDENT


def test_colours_in_gamut_are_returned_as_they_are(rng: np.random.Generator) -> None:
    rgb = torch.from_numpy(rng.uniform(0, 3, (1000, 3)))
    rgb[0], rgb[1, 1] = 0.0, 0.0
    assert torch.equal(desaturate(rgb), rgb)


def test_colour_without_positive_luminance_becomes_black() -> None:
    rgb = torch.tensor([[0.1, -1.0, 0.2], [-0.1, -0.2, -0.3], [-0.7152, 0.2126, 0.0]])
    assert torch.equal(desaturate(rgb), torch.zeros(3, 3))


def test_desaturation_is_differentiable(outside: Tensor) -> None:
    # A step of gradcheck must not change which channel is smallest or the sign of a channel.
    ordered = outside.sort(-1).values
    clear = outside[((ordered[:, 1] - ordered[:, 0]) > 0.01) & (outside.abs() > 0.01).all(-1)][:20]
    assert torch.autograd.gradcheck(desaturate, clear.requires_grad_())


def test_desaturation_has_finite_derivatives_where_it_has_kinks() -> None:
    rgb = torch.tensor(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-1.0, -1.0, 9.0], [-1.0, 0.0, 0.0], [-1e-30, 1e-30, 0.0]],
        requires_grad=True,
    )
    desaturate(rgb).sum().backward()
    assert rgb.grad is not None
    assert rgb.grad.isfinite().all()


def test_slow_packages_are_not_imported_with_ours() -> None:
    code = "import sys, matest.spectra; sys.exit(bool({'colour', 'mitsuba'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
