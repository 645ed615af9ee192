"""Models fitted to measured reflectances: the papers' samples, costs, verdicts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.optimize import least_squares
from torch import Tensor

from matest.brdf import Brdf, CookTorrance, OrenNayar, preset
from matest.errors import InputError
from matest.estimation import table_fit
from matest.estimation.table_fit import TableFit, fit_table
from matest.tables import Declaration, Table, load_table
from matest.tables.loss import Loss
from tests.shared_data import measurement
from tests.tables.goniometer import hemispherical, in_plane, measured

LAMPS = [0.61, 0.55, 0.46]
SAMPLES = {
    "ground-glass": "li-torrance(uniform=on,subsurface=off)",
    "red-paint": "li-torrance(forward=on)",
    "laser-paper": "li-torrance(forward=on)",
}


def in_standard_errors(fit: TableFit, truth: Brdf) -> dict[str, list[float]]:
    """How far every determined estimate is from the truth."""
    values: dict[str, Tensor] = dict(truth.parameters)
    if "height_rms" in values:
        values["slope_ratio"] = values["height_rms"] / values["correlation_length"]
    out = {}
    for name, parameter in fit.estimate.parameters.items():
        value, std = np.atleast_1d(np.array(parameter.value, float)), np.atleast_1d(np.array(parameter.std, float))
        known = np.isfinite(value) & np.isfinite(std)
        if known.any():
            out[name] = ((value - values[name].numpy())[known] / std[known]).tolist()
    return out


@pytest.mark.parametrize("noise", [0.01, None], ids=["stated", "estimated"])
@pytest.mark.parametrize("sample", SAMPLES)
def test_li_and_torrances_samples_are_found_again(sample: str, noise: float | None) -> None:
    truth = preset(sample)
    fit = fit_table(measured(truth, hemispherical()), SAMPLES[sample], noise=noise, fix={"f0": float(truth.f0)})
    errors = in_standard_errors(fit, truth)
    assert max(abs(error) for each in errors.values() for error in each) < 3
    # Of the two lengths only their ratio has an effect.
    assert fit.estimate.parameters["slope_ratio"].status == "determined"
    assert fit.estimate.parameters["correlation_length"].value is None
    assert fit.estimate.fit.errors == "fisher"
    assert fit.verdict == ""
    assert fit.samples.noise.relative.tolist() == pytest.approx([0.01] * 3, rel=0.06)


@pytest.mark.parametrize("noise", [0.01, None], ids=["stated", "estimated"])
def test_coherent_light_gives_both_lengths(noise: float | None) -> None:
    truth = preset("non-glare-glass").replace({"wavelength": LAMPS})
    fixed: dict[str, Any] = {"f0": 0.92, "k_dd": 1, "wavelength": LAMPS, "solid_angle": 5e-4}
    expression = "li-torrance(coherent=on,masking=off,subsurface=off)"
    fit = fit_table(measured(truth, in_plane()), expression, noise=noise, fix=fixed)
    errors = in_standard_errors(fit, truth)
    for length in ("height_rms", "correlation_length"):
        assert fit.estimate.parameters[length].status == "determined"
        assert abs(errors[length][0]) < 3


def coarse() -> tuple[Tensor, Tensor]:
    """A sixth of the hemispherical grid."""
    wi, wo = hemispherical()
    return wi[::6], wo[::6]


def test_what_the_table_does_not_state_of_the_light_is_told() -> None:
    table = measured(preset("non-glare-glass"), in_plane())
    fit = fit_table(table, "li-torrance(coherent=on,masking=off,subsurface=off)", fix={"f0": 0.92, "k_dd": 1})
    assert any("wavelength is taken as 0.55 µm: the table does not say it" in one for one in fit.estimate.warnings)


MISFIT = CookTorrance(0.3, 0.9, 0.2, distribution="ggx")


def cost(loss: Loss, table: Table, f: np.ndarray) -> np.ndarray:
    """The residuals of each cost as its paper writes it."""
    cosine, true = table.wi[:, 2].numpy(), table.values[:, 0].numpy()
    return {
        Loss.LI_TORRANCE: np.sqrt(cosine) * (f - true),
        Loss.LOG: np.log(1 + cosine * f) - np.log(1 + cosine * true),
        Loss.CUBE_ROOT: np.cbrt(cosine * f) - np.cbrt(cosine * true),
    }[loss]


@pytest.mark.parametrize("loss", [Loss.LI_TORRANCE, Loss.LOG, Loss.CUBE_ROOT])
def test_a_fit_is_at_the_least_cost_though_the_model_does_not_hold(loss: Loss) -> None:
    table = measured(MISFIT, coarse())

    def residuals(x: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            model = CookTorrance(*torch.from_numpy(x), f0=0.04)(table.wi, table.wo)
        return cost(loss, table, model[:, 0].numpy())

    best = least_squares(residuals, [0.3, 0.7, 0.2], bounds=([0, 0, 0.01], [1, 1, 1]), xtol=1e-12, ftol=1e-12)
    fit = fit_table(table, "cook-torrance", loss=loss, fix={"f0": 0.04})
    names = ("diffuse", "specular", "slope")
    values = [float(np.array(fit.estimate.parameters[name].value)) for name in names]
    std = [float(np.array(fit.estimate.parameters[name].std, float)) for name in names]
    assert fit.estimate.fit.errors == "jackknife over incidences"
    assert np.abs((values - best.x) / std).max() < 0.05
    assert (residuals(np.array(values)) ** 2).sum() == pytest.approx((best.fun**2).sum(), rel=1e-4)


def test_errors_are_reported_by_incidence_and_channel() -> None:
    table = measured(MISFIT, coarse())
    fit = fit_table(table, "cook-torrance", fix={"f0": 0.04})
    content = fit.to_dict()
    assert content["schema"] == "matest.fit/1"
    assert [round(math.degrees(one["theta_i"])) for one in content["incidences"]] == [*range(10, 81, 10)]
    with torch.no_grad():
        y, mu = (values * table.wi[:, 2:] for values in (table.values, fit.estimate.material(table.wi, table.wo)))
    at_40 = (table.wi[:, 2].acos() - math.radians(40)).abs() < 0.01
    assert content["incidences"][3]["relative_rmse"] == pytest.approx(float((y - mu)[at_40].norm() / y[at_40].norm()))
    roots = (y ** (1 / 3) - mu ** (1 / 3)).square().mean().sqrt()
    assert content["fit"]["cube_root_error"] == pytest.approx(float(roots))
    assert content["channels"][0]["cube_root_error"] == pytest.approx(float(roots))


def test_stated_noise_that_the_model_misses_is_told() -> None:
    fit = fit_table(measured(MISFIT, coarse()), "cook-torrance", noise=0.01)
    assert "does not hold to the stated noise" in fit.estimate.fit.message
    assert fit.estimate.fit.errors == "jackknife over incidences"


def test_auto_chooses_a_model_and_says_why() -> None:
    fit = fit_table(measured(OrenNayar(0.7, 0.6), coarse()), noise=0.01)
    assert fit.estimate.model == "oren-nayar"
    assert any("incidence" in candidate.reason for candidate in fit.estimate.candidates)
    assert fit.verdict == ""


def retroreflective() -> Table:
    """A tape of corner cubes: bright toward the light only."""
    wi, wo = coarse()
    angle = (wi * wo).sum(-1, keepdim=True).clamp(-1, 1).acos()
    values = 0.02 + 5 * wi[:, 2:] * torch.exp(-((angle / 0.25) ** 2))
    return Table(Path("tape.csv"), wi, wo, values, ("value",))


def test_where_no_model_fits_it_is_said_first_and_plainly() -> None:
    fit = fit_table(retroreflective())
    assert fit.estimate.warnings[0] == fit.verdict
    assert fit.verdict.startswith("No model of the catalogue fits this table: ")
    named = fit_table(retroreflective(), "lambert")
    assert named.verdict.startswith("lambert does not fit this table: ")


def test_only_the_model_that_is_chosen_is_searched_for_among_all_values(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: dict[str, list[Any]] = {"select": [], "solve": []}

    def counted(name: str) -> Any:
        function = getattr(table_fit, name)

        def call(*arguments: Any) -> Any:
            calls[name].append(arguments[0])
            return function(*arguments)

        return call

    for name in calls:
        monkeypatch.setattr(table_fit, name, counted(name))
    fit = fit_table(retroreflective())
    guess, estimate = (samples.noise.relative.tolist() for samples in calls["select"])
    assert guess == [0.05]
    assert estimate != guess
    assert {*calls["solve"]} == {fit.estimate.model}


def test_the_choice_for_a_measured_enamel_is_the_one_under_the_noise_that_it_leaves() -> None:
    table = load_table(measurement("cornell", "krylon_blue.brdf"), Declaration(channels="rgb"))
    fit = fit_table(table)
    assert fit.estimate.model == "cook-torrance(lobes=2)"
    assert fit.verdict.startswith("No model of the catalogue fits this table: cook-torrance(lobes=2), the best, misses")


def test_few_incidences_give_no_honest_error_bars() -> None:
    table = measured(MISFIT, coarse())
    few = (table.wi[:, 2].acos() < math.radians(25)).nonzero()[:, 0]
    part = Table(table.path, table.wi[few], table.wo[few], table.values[few], table.channels)
    fit = fit_table(part, "lambert", loss="cube-root")
    assert any(one.startswith("2 incidences are too few") for one in fit.estimate.warnings)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (torch.full((5, 1), 0.1), "expected 8 pairs of directions or more, and it has 5"),
        (torch.zeros(20, 1), "expected reflectances above zero"),
        (torch.full((20, 1), 1e300, dtype=torch.float64), "expected reflectances in 1/sr, and one is 1e[+]300"),
    ],
)
def test_tables_that_say_nothing_are_refused(values: Tensor, words: str) -> None:
    wi, wo = in_plane()
    table = Table(Path("a.csv"), wi[: len(values)], wo[: len(values)], values.double(), ("value",))
    with pytest.raises(InputError, match=f"a.csv: {words}"):
        fit_table(table)


def test_names_are_checked() -> None:
    table = measured(OrenNayar(0.7, 0.6), in_plane(20))
    with pytest.raises(InputError, match="no parameter 'sigmo'"):
        fit_table(table, "oren-nayar", fix={"sigmo": 1})


def test_a_measured_enamel_is_fitted_as_published() -> None:
    table = load_table(measurement("cornell", "krylon_blue.brdf"), Declaration(channels="450"))
    fit = fit_table(table, "cook-torrance", loss="cube-root")
    assert fit.estimate.parameters["diffuse"].value == pytest.approx(0.24, abs=0.01)
    assert fit.estimate.parameters["slope"].value == pytest.approx(0.155, abs=0.005)
    assert fit.misfit.cube_root_error < 0.045


def test_the_dark_bands_of_an_enamel_have_larger_errors() -> None:
    table = load_table(measurement("cornell", "krylon_blue.brdf"), Declaration(channels="450,550,650"))
    fit = fit_table(table, "cook-torrance", loss="cube-root")
    blue, *dark = (channel.cube_root_error for channel in fit.channels)
    assert blue < min(dark) < 0.05


def test_a_mirror_like_enamel_gets_an_honest_verdict() -> None:
    table = load_table(measurement("cornell", "acryl_blue.brdf"), Declaration(channels="rgb"))
    fit = fit_table(table, "cook-torrance")
    assert "18,901 of 44,609 values are not positive" in " ".join(fit.estimate.warnings)
    assert "does not fit this table" in fit.verdict
