"""Before any fit: which parameters some photographs determine, how well, why not, and which light would help most."""

from matest.identifiability.facade import Check, LightAdvice, Prediction, check, check_with
from matest.identifiability.plan import Plan, load_plan

__all__ = ["Check", "LightAdvice", "Plan", "Prediction", "check", "check_with", "load_plan"]
