"""matest: what a surface is made of, with error bars, from photographs of an object of known shape and light.

Importing this package loads nothing heavy; each name below is imported when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from matest.errors import InputError

if TYPE_CHECKING:
    from matest import brdf, losses
    from matest.capture import Capture, load_capture
    from matest.estimation.estimate import estimate
    from matest.estimation.parameter_map import with_maps
    from matest.estimation.prediction import predict
    from matest.estimation.result import Estimate, load_material
    from matest.estimation.table_fit import fit_table
    from matest.identifiability import check, load_plan
    from matest.report.maps import load_maps
    from matest.scene import Scene
    from matest.shading import render, shade
    from matest.simulate import load_scene
    from matest.tables import load_table
    from matest.training.gradient import fit_gradient
    from matest.training.trainable import Trainable

__version__ = "0.1.0"

_HOME = {
    "Capture": "matest.capture",
    "Estimate": "matest.estimation.result",
    "Scene": "matest.scene",
    "Trainable": "matest.training.trainable",
    "check": "matest.identifiability",
    "estimate": "matest.estimation.estimate",
    "fit_gradient": "matest.training.gradient",
    "fit_table": "matest.estimation.table_fit",
    "load_capture": "matest.capture",
    "load_maps": "matest.report.maps",
    "load_material": "matest.estimation.result",
    "load_plan": "matest.identifiability",
    "load_scene": "matest.simulate",
    "load_table": "matest.tables",
    "predict": "matest.estimation.prediction",
    "render": "matest.shading",
    "shade": "matest.shading",
    "with_maps": "matest.estimation.parameter_map",
}
_MODULES = ("brdf", "losses")

__all__ = [
    "Capture",
    "Estimate",
    "InputError",
    "Scene",
    "Trainable",
    "brdf",
    "check",
    "estimate",
    "fit_gradient",
    "fit_table",
    "load_capture",
    "load_maps",
    "load_material",
    "load_plan",
    "load_scene",
    "load_table",
    "losses",
    "predict",
    "render",
    "shade",
    "with_maps",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"matest.{name}")
    if name in _HOME:
        value = getattr(importlib.import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'matest' has no attribute '{name}'")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
