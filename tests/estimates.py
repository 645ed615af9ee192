"""Estimates made by hand, for tests of results and reports."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from matest.brdf import OrenNayar
from matest.estimation.result import Candidate, Estimate, Fit
from matest.inference.quantities import ParameterEstimate

ALBEDO = ParameterEstimate(
    value=[0.7, 0.6, 0.5],
    std=[0.0012, 0.0011, 0.001],
    interval95=[[0.6976, 0.7024], [0.5978, 0.6022], [0.498, 0.502]],
    unit="1",
    status="determined",
    doc="facet albedo ρ",
)
SIGMA = ParameterEstimate(0.5236, 0.0021, [0.5195, 0.5277], "rad", "determined", "std. deviation of the slope angle")
FIXED = ParameterEstimate(0.04, None, None, "1", "fixed", "reflectance at normal incidence")
LOST = ParameterEstimate(None, None, None, "1", "not determined", "weight of the surface reflection")
CLAY = Estimate(
    capture="vase",
    model="oren-nayar",
    material=OrenNayar([0.7, 0.6, 0.5], 0.5236),
    parameters={"albedo": ALBEDO, "sigma": SIGMA},
    labels=["albedo[0]", "albedo[1]", "albedo[2]", "sigma"],
    correlation=[[1.0 if i == j else 0.5 for j in range(4)] for i in range(4)],
    fit=Fit(
        rmse=0.004,
        relative_rmse=0.0113,
        relative_rmse_trimmed=0.0113,
        reduced_chi2=1.02,
        samples=123456,
        samples_used=120000,
        iterations=2,
        status="converged",
        message="Converged; the model describes the images to their noise.",
        errors="fisher",
    ),
    relative=False,
    candidates=[
        Candidate("lambert", 0.09, 0.09, "the simplest model tried"),
        Candidate("oren-nayar", 0.011, 0.011, "predicts images left out better than lambert: error 88% smaller", True),
    ],
    skipped={
        "components": ["cook-torrance"],
        "samples": {"background": 500, "shadowed": 40, "saturated": 0, "rim": 60, "redundant": 0, "held_out": 7},
        "work": ["ambient light: there is none"],
    },
    timing_s={"read": 0.1, "geometry": 0.2, "fit": 0.3},
    holdout={"images": [0], "relative_rmse": 0.02, "median_error": 0.013},
    provenance={"matest": "0.1.0", "command": "matest estimate vase", "inputs": {"00.png": "sha256:0"}},
    warnings=["Noise was estimated from the images."],
)


def clay(**changes: Any) -> Estimate:
    """The estimate of a clay vase, with some attributes changed."""
    return replace(CLAY, **changes)
