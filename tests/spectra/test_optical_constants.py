"""Optical constants of metals."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import Tensor

from matest.errors import InputError
from matest.spectra import OpticalConstants, metal_colour, normal_reflectance, optical_constants
from tests import tolerances
from tests.captures import refusal

# The function of that name hides the module.
MODULE = sys.modules["matest.spectra.optical_constants"]
needs_mitsuba = pytest.mark.skipif(PathFinder.find_spec("mitsuba") is None, reason="Mitsuba is not installed")

# Three wavelengths, n and k, in every layout that a file may have.
WAVELENGTHS, ETA, K = [0.4, 0.5, 0.7], [1.5, 1.25, 0.25], [2.0, 2.5, 4.0]
LAYOUTS = {
    "comma": "wl,n,k\n0.4,1.5,2\n0.5,1.25,2.5\n0.7,0.25,4\n",
    "space": "0.4 1.5 2\n0.5\t1.25  2.5\n\n 0.7 0.25 4 # the last\n",
    "semicolon": "0.4; 1.5; 2\n0.5; 1.25; 2.5\n0.7; 0.25; 4\n",
    "nanometres": "Wavelength (nm), n, k\n400,1.5,2\n500,1.25,2.5\n700,0.25,4\n",
    "blocks": "wl,n\n0.4,1.5\n0.5,1.25\n0.7,0.25\n\nwl,k\n0.4,2\n0.5,2.5\n0.7,4\n",
    "unsorted": "0.7 .25 4\n0.4 1.5 2\n0.5 1.25 2.5\n",
    "byte order mark": "\ufeff0.4,1.5,2\r\n0.5,1.25,2.5\r\n0.7,0.25,4\r\n",
}


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return tmp_path / "table.csv"


@pytest.fixture
def constants() -> OpticalConstants:
    at, eta, k = torch.tensor([WAVELENGTHS, ETA, K], dtype=torch.float64)
    return OpticalConstants(at, eta, k, "made up")


@pytest.fixture
def mitsuba(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of tables of an installed Mitsuba that has none yet."""
    spec = ModuleSpec("mitsuba", None, is_package=True)
    spec.submodule_search_locations = [str(tmp_path)]
    monkeypatch.setattr(
        sys.modules["matest.spectra.optical_constants"], "PathFinder", SimpleNamespace(find_spec={"mitsuba": spec}.get)
    )
    folder = tmp_path / "data" / "ior"
    folder.mkdir(parents=True)
    return folder


def write_spd(folder: Path, stem: str, eta: float) -> None:
    (folder / f"{stem}.eta.spd").write_text(f"# measured by A\n400 {eta}\n700 {eta}\n")
    (folder / f"{stem}.k.spd").write_text("# measured by A\n400 1\n700 1\n")


def columns(constants: OpticalConstants) -> list[list[float]]:
    return [constants.wavelengths.tolist(), constants.eta.tolist(), constants.k.tolist()]


@needs_mitsuba
@pytest.mark.parametrize(
    ("metal", "printed"),
    [
        ("copper", [0.955, 0.638, 0.538]),
        ("gold", [1.022, 0.783, 0.343]),
        ("silver", [0.971, 0.960, 0.915]),
        ("aluminium", [0.913, 0.922, 0.924]),
        ("chromium", [0.635, 0.662, 0.705]),
        ("tungsten", [0.515, 0.496, 0.468]),
        ("nickel", [0.659, 0.609, 0.526]),
    ],
)
def test_colour_of_metal_to_three_decimals(metal: str, printed: list[float]) -> None:
    assert metal_colour(metal).numpy().round(3).tolist() == printed


@needs_mitsuba
@pytest.mark.parametrize("name", ["copper", "Copper", "Cu", "cu"])
def test_metal_by_english_name_or_symbol(name: str) -> None:
    assert optical_constants(name).source.startswith("Cu.eta.spd and Cu.k.spd (data from www.luxpop.com")


@needs_mitsuba
def test_table_of_copper_at_a_tabulated_wavelength() -> None:
    eta, k = optical_constants("copper").at(torch.tensor([0.302400421, 0.885601257], dtype=torch.float64))
    assert (eta.tolist(), k.tolist()) == ([1.38, 0.3], [1.687, 5.717])


@needs_mitsuba
def test_table_that_ends_within_the_visible_is_refused() -> None:
    with pytest.raises(InputError, match=r"tabulated from 0\.306123 to 0\.751394 µm"):
        metal_colour("lithium")


@needs_mitsuba
def test_table_with_zeros_for_unknown_is_refused() -> None:
    with pytest.raises(InputError, match=r"AlAs\.eta\.spd.* n must be positive, but is 0 at 0\.3935"):
        optical_constants("AlAs")


def test_plain_table_is_taken_before_palik(mitsuba: Path) -> None:
    for stem, eta in {"Cu": 1, "Cu_palik": 2, "Ni_palik": 3, "TiN": 4}.items():
        write_spd(mitsuba, stem, eta)
    found = {name: optical_constants(name).eta[0].item() for name in ("copper", "Cu_palik", "nickel", "Ni", "TiN")}
    assert found == {"copper": 1, "Cu_palik": 2, "nickel": 3, "Ni": 3, "TiN": 4}


def test_source_names_the_files_and_quotes_their_comments_once(mitsuba: Path) -> None:
    write_spd(mitsuba, "Au", 1)
    assert optical_constants("gold").source == "Au.eta.spd and Au.k.spd (measured by A)"


def test_unknown_metal_names_the_nearest(mitsuba: Path) -> None:
    write_spd(mitsuba, "Cu", 1)
    with pytest.raises(InputError, match=r"'Coper' .*; did you mean 'copper'\?"):
        optical_constants("Coper")


def test_metal_without_table_is_refused(mitsuba: Path) -> None:
    write_spd(mitsuba, "Cu", 1)
    with pytest.raises(InputError, match="no optical constants of 'gold'"):
        optical_constants("gold")


def test_without_mitsuba_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        sys.modules["matest.spectra.optical_constants"], "PathFinder", SimpleNamespace(find_spec=lambda _: None)
    )
    with pytest.raises(InputError, match=r'pip install "matest-brdf\[metals\]", or give a file'):
        optical_constants("copper")


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_of_a_file_gives_the_same(table: Path, layout: str) -> None:
    table.write_text(LAYOUTS[layout], encoding="utf-8")
    assert columns(optical_constants(table)) == [WAVELENGTHS, ETA, K]


def test_pair_of_files(tmp_path: Path) -> None:
    eta, k = tmp_path / "x.eta.spd", tmp_path / "x.k.spd"
    eta.write_text("400 1.5\n500 1.25\n700 .25\n")
    k.write_text("400 2\n500 2.5\n700 4\n")
    assert columns(optical_constants(str(eta), str(k))) == [WAVELENGTHS, ETA, K]


def test_n_and_k_at_different_wavelengths_share_all_those_in_common(table: Path) -> None:
    table.write_text("wl,n\n0.4,1\n0.6,3\nwl,k\n0.5,2\n0.7,4\n")
    assert columns(optical_constants(table)) == [[0.5, 0.6], pytest.approx([2, 3]), pytest.approx([2, 3])]


def test_infrared_table_in_micrometres_stays_in_micrometres(table: Path) -> None:
    table.write_text("0.4 1 2\n55.6 2 3\n")
    assert optical_constants(table).wavelengths.tolist() == [0.4, 55.6]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("0.4,1,2\n0.5,one,2\n", "line 2 must hold .* but is '0.5,one,2'"),
        ("0.4,1,2\n0.5,1\n", "line 2 must hold"),
        ("0.4,1,2,3\n", "line 1 must hold"),
        ("# comment\nwl,n,k\n0.4,-1,2\n", "line 3 must hold"),
        ("0.4,1,2\nnan,nan,nan\n", "line 2 must hold"),
        ("0.4,1,2\n0.5,0,2\n", "n must be positive, but is 0 at 0.5 µm"),
        ("0.4,1,2\n0.4,2,3\n", "but 0.4 µm comes twice"),
        ("0.4,1,2\n", "fewer than two wavelengths in common"),
        ("wl,n\n0.4,1\n0.5,1\nwl,k\n0.6,1\n0.7,1\n", "fewer than two wavelengths in common"),
        ("wl,n\n0.4,1\n0.5,1\n", "expected columns .*; but 2 columns"),
        ("wl,n,k\n0.4,1,2\nwl,k\n0.5,1\n", "but 3 and 2 columns"),
        ("nothing here\n", "but no columns"),
    ],
)
def test_malformed_file_is_named_with_its_fault(table: Path, text: str, complaint: str) -> None:
    table.write_text(text)
    with pytest.raises(InputError, match=f"table.csv: .*{complaint}"):
        optical_constants(table)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="missing: No such file"):
        optical_constants(tmp_path / "missing")


def test_constants_are_linear_between_tabulated_wavelengths(constants: OpticalConstants) -> None:
    eta, k = constants.at(torch.tensor([[0.4, 0.45], [0.6, 0.7]], dtype=torch.float64))
    assert eta.numpy() == pytest.approx(np.array([[1.5, 1.375], [0.75, 0.25]]), rel=tolerances.INDEPENDENT)
    assert k.numpy() == pytest.approx(np.array([[2, 2.25], [3.25, 4]]), rel=tolerances.INDEPENDENT)


def test_constants_have_the_type_of_the_wavelengths(constants: OpticalConstants) -> None:
    assert [values.dtype for values in constants.at(torch.tensor([0.5]))] == [torch.float32, torch.float32]


@pytest.mark.parametrize("at", [[0.39, 0.5], [0.5, 0.71], [float("nan"), 0.5]])
def test_wavelengths_beyond_the_table_are_refused(constants: OpticalConstants, at: list[float]) -> None:
    with pytest.raises(InputError, match=r"tabulated from 0\.4 to 0\.7 µm, but .* beyond the table made up\."):
        constants.at(torch.tensor(at, dtype=torch.float64))


def test_normal_reflectance_is_the_square_of_the_complex_amplitude(rng: np.random.Generator) -> None:
    eta, k = torch.from_numpy(rng.uniform(0.05, 5, (2, 100)))
    index = torch.complex(eta, -k)
    expected: Tensor = ((index - 1) / (index + 1)).abs().square()
    torch.testing.assert_close(normal_reflectance(eta, k), expected, rtol=tolerances.INDEPENDENT, atol=0)


def test_immense_numbers_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("0.4 0.2 3.1\n0.5 1e308 3.2\n")
    assert "line 2" in refusal(lambda: optical_constants(tmp_path / "a.txt"))
