"""Table 4 of Li and Torrance: the cost of their model beside the others', each fitted to the same four samples."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence

import torch
from rich.console import RenderableType
from rich.text import Text
from torch import Tensor

from matest.benchmark.instruments.passes import TILE, element_wise, forward, random_directions, seconds
from matest.benchmark.suite import Progress, Record
from matest.benchmark.tables import by_case, case_name, figure, ruled
from matest.brdf import Brdf, LiTorrance, model, preset
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.estimators import fit_batches
from matest.samples import Batch
from matest.samples.likelihood import MeasurementNoise, Readout
from matest.scene import Points

# The paper's seconds for a million values, over the coefficients of the four samples.
PUBLISHED = {
    "blinn-phong": (1.1, 1.1),
    "neumann-neumann": (3.5, 4.0),
    "lafortune": (2.3, 3.9),
    "ward": (2.0, 2.1),
    "cook-torrance": (3.3, 3.5),
    "he-torrance": (59.0, 121.9),
    "li-torrance": (4.3, 6.8),
}
SAMPLES = {"#45": "non-glare-glass", "#41": "ground-glass", "#13": "red-paint", "#73": "laser-paper"}
# Green: k_ud, k_dd, σ0, τ of He and Torrance's model in Tables 1-3; of #45 its reflectance alone is in the text.
_HE_TORRANCE = {
    "#45": (0.0, 1.0, 0.23, 10.4),
    "#41": (0.32, 0.47, 0.90, 5.2),
    "#13": (0.0, 0.53, 0.64, 8.2),
    "#73": (0.75, 0.39, 0.54, 5.6),
}
# Li-Torrance with the components that a sample needs, against Cook-Torrance, at most.
COST_LIMIT = 2.0
# The model whose cost is the unit, the one that ours is held to, and the one that ours approximates.
UNIT = "blinn-phong"
RIVAL = "cook-torrance"
OURS = "li-torrance"
REFERENCE = "he-torrance"
# What the names of the records' cases begin with.
CASE = "table 4: "
WITHOUT = "li-torrance without "
# He and Torrance's series is timed on so much fewer pairs.
_SLOW_SHARE = 100
# Degrees from the normal of the lights that a sample is measured under.
_LIGHTS = (20, 40, 50, 70)
# Views near the mirror direction, and as many anywhere, of each light.
_VIEWS = 1500
_ALL = "uniform=on,subsurface=on,forward=on,coherent=on"
# A component (or masking), the model with all, and that without it.
DROPPED = {
    "directional": ("uniform=on,forward=on", "uniform=on,forward=on,directional=off"),
    "uniform": (_ALL, "subsurface=on,forward=on,coherent=on"),
    "subsurface": (_ALL, "uniform=on,subsurface=off,forward=on,coherent=on"),
    "forward": (_ALL, "uniform=on,subsurface=on,coherent=on"),
    "coherent": (_ALL, "uniform=on,subsurface=on,forward=on"),
    "masking": (_ALL, f"{_ALL},masking=off"),
}


def measure(pairs: int, progress: Progress) -> Iterator[Record]:
    """Cost of every model with its coefficients of every sample, as multiples of Blinn and Phong's; errors of the fits.

    The measured reflectances are not public. The constructed model's published fits stand for them, and the other
    models are fitted to these with the paper's cost (eq. 15); He and Torrance's coefficients are published too.
    """
    wi, wo = random_directions(pairs)
    for number, sample in enumerate(SAMPLES):
        progress(f"Table 4: {sample}", number, len(SAMPLES))
        fitted = {name: coefficients(name, sample) for name in PUBLISHED}
        shares = {name: _SLOW_SHARE if name == REFERENCE else 1 for name in fitted}
        single = {name: brdf.to(torch.float32, "cpu") for name, brdf in fitted.items()}
        runs = [forward(brdf, wi[:: shares[name]], wo[:: shares[name]], TILE) for name, brdf in single.items()]
        # For all pairs.
        times = {name: time * shares[name] for name, time in zip(fitted, seconds(*runs), strict=True)}
        for name, time in times.items():
            yield Record("models", f"{CASE}{name}", f"{sample} cost", time / times[UNIT], UNIT)
            yield Record("models", f"{CASE}{name}", f"{sample} error of fit", misfit(fitted[name], sample), "1")
        cost = times[OURS] / times[RIVAL]
        yield Record("models", f"{CASE}{OURS}", f"{sample} needed components", cost, RIVAL, limit=COST_LIMIT)
    progress("Table 4: components", len(SAMPLES), len(SAMPLES))
    yield from _savings(wi, wo)


def _savings(wi: Tensor, wo: Tensor) -> Iterator[Record]:
    """What leaving out a component saves, beside its share of the passes, each timed by itself."""
    for name, expressions in DROPPED.items():
        both = [model(f"{OURS}({options})")[0].to(torch.float32, "cpu") for options in expressions]
        times = seconds(*(forward(brdf, wi, wo, TILE) for brdf in both))
        alone = [element_wise(lambda brdf=brdf: brdf(wi[:TILE], wo[:TILE]))[1] for brdf in both]  # type: ignore[misc]
        case = f"{WITHOUT}{name}"
        yield Record("models", case, "time saved", 1 - times[1] / times[0], "1", "higher")
        yield Record("models", case, "share of the passes", 1 - alone[1] / alone[0], "1", "higher")


def coefficients(name: str, sample: str) -> Brdf:
    """A model with its coefficients for a sample's green channel: published, or fitted to the published."""
    published = _green(preset(SAMPLES[sample]))
    if name == OURS:
        return published
    if name == REFERENCE:
        k_ud, k_dd, height, length = _HE_TORRANCE[sample]
        options = "(coherent=on)" if published.coherent == "on" else ""
        values = {"k_ud": k_ud, "k_dd": k_dd, "height_rms": height, "correlation_length": length}
        return model(f"{name}{options}")[0].replace({**values, "f0": published.f0})
    fix = {"f0": float(published.f0)} if name == RIVAL else {}
    problem = specify(name, Options(fix=fix), channels=1, relative=False).problem
    solution = fit_batches(problem, [_table(published)])
    return solution.problem.material(solution.unknowns)


def misfit(brdf: Brdf, sample: str) -> float:
    """Root of eq. 15's cost over that of the sample itself."""
    table, compared = _table(_green(preset(SAMPLES[sample]))), _without_mirror(brdf)
    wi, wo = table.points.wi[:, 0], table.points.wo
    with torch.no_grad():
        difference = compared(wi, wo) * wi[:, 2:].sqrt() - table.radiance
    return float(difference.square().sum().sqrt() / table.radiance.square().sum().sqrt())


def _green(brdf: Brdf) -> LiTorrance:
    green = brdf.replace({name: value[1] for name, value in brdf.parameters.items() if value.ndim})
    assert isinstance(green, LiTorrance)
    return green


def _table(published: LiTorrance) -> Batch:
    """Reflectances of a sample, half of them near the mirror direction, as samples whose χ² is eq. 15's cost.

    Without the mirror-like component, which no goniometer's grid of directions resolves.
    """
    brdf = _without_mirror(published)
    generator = torch.Generator().manual_seed(0)
    width = 2 * float(published.height_rms / published.correlation_length)
    wi, wo = [], []
    for theta in _LIGHTS:
        light = torch.tensor([math.sin(math.radians(theta)), 0.0, math.cos(math.radians(theta))], dtype=torch.float64)
        mirror = light * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
        spread = 4 * width * torch.randn(_VIEWS, 3, generator=generator, dtype=torch.float64)
        wide = torch.randn(_VIEWS, 3, generator=generator, dtype=torch.float64)
        views = torch.nn.functional.normalize(torch.cat([mirror + spread, wide]), dim=-1)
        views = views[views[:, 2] > math.cos(math.radians(80))]
        wi.append(light.expand(len(views), 3))
        wo.append(views)
    lights, views = torch.cat(wi), torch.cat(wo)
    # Radiance f √cos θi under the irradiance 1/√cos θi: squares of residuals are eq. 15's.
    root = lights[:, 2:].sqrt()
    points = Points(lights[:, None], views, 1 / root[:, None])
    with torch.no_grad():
        radiance = brdf(lights, views) * root
    # So much noise that no value is an outlier: a plain sum of squares.
    read = (radiance.max() / 4).square().reshape(1, 1)
    return Batch(points, radiance, MeasurementNoise(Readout(read, torch.zeros_like(read))))


def _without_mirror(brdf: Brdf) -> Brdf:
    if getattr(brdf, "coherent", "off") == "off":
        return brdf
    return dataclasses.replace(brdf, coherent="off")  # type: ignore[type-var]


def tables(records: Sequence[Record]) -> list[RenderableType]:
    """Cost of every model and the error of its fit, and what leaving out a component saves."""
    cases = by_case(records)
    costs = ruled("Table 4", "paper", *SAMPLES, "error\nof fit", "", "", "")
    unit = PUBLISHED[UNIT][0]
    for name, published in PUBLISHED.items():
        metrics = cases[f"{CASE}{name}"]
        paper = " - ".join(f"{one / unit:.1f}" for one in dict.fromkeys(published))
        errors = [f"{metrics[f'{sample} error of fit'].value:.0%}" for sample in SAMPLES]
        values = [metrics[f"{sample} cost"].value or 0.0 for sample in SAMPLES]
        row = [f"{value:.2f}" if value < 10 else f"{value:,.0f}" for value in values]
        costs.add_row(case_name(name), paper, *row, *errors)
    ours = cases[f"{CASE}{OURS}"]
    rival = ruled("", *SAMPLES)
    needed = (ours[f"{sample} needed components"] for sample in SAMPLES)
    rival.add_row(Text(f"{OURS} / {RIVAL}"), *map(figure, needed))
    savings = ruled("li-torrance without", "time saved", "its share\nof the passes")
    for name in DROPPED:
        shares = (cases[f"{WITHOUT}{name}"][metric].value for metric in ("time saved", "share of the passes"))
        savings.add_row(Text(name), *(f"{share:.1%}" for share in shares))
    about = (
        f"Table 4 of Li & Torrance (2005): run time as a multiple of {UNIT}'s, in the paper (its range over the "
        "samples) and here (green channel of each sample, float32, tiled), and the error of each model's fit: of the "
        "published fit, for the measurements are not public, in the same order."
    )
    return ["", Text(about), "", costs, "", rival, "", savings]
