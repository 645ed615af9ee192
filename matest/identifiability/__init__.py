"""Before any fit: which parameters some photographs determine, how well, why not, and which light would help most."""

from matest.identifiability.advice import LightAdvice
from matest.identifiability.calibration import CalibrationError, CalibrationLimit
from matest.identifiability.facade import Check, check, check_with
from matest.identifiability.maps import MapForecast, MappedParameter, MapsForecast, SomePhotographs
from matest.identifiability.plan import Plan, load_plan
from matest.identifiability.predictions import Prediction

__all__ = [
    "CalibrationError",
    "CalibrationLimit",
    "Check",
    "LightAdvice",
    "MapForecast",
    "MappedParameter",
    "MapsForecast",
    "Plan",
    "Prediction",
    "SomePhotographs",
    "check",
    "check_with",
    "load_plan",
]
