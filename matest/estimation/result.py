"""The outcome of an estimate: parameters with error bars, how the fit went, and its JSON form."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch

from matest.brdf import Brdf, model
from matest.errors import InputError
from matest.estimation.calibration import NuisanceEstimate
from matest.estimation.misreading import Misreading
from matest.estimation.parameter_map import ParameterMap, map_file
from matest.estimation.photographs import PhotographFit
from matest.estimation.remedies import Diagnosis
from matest.estimation.residual_angles import AngularResiduals
from matest.inference.quantities import ParameterEstimate, channel_names
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale

SCHEMA = "matest.estimate/1"
# How far a stored value may be outside its domain.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Fit:
    """How well the model describes the images.

    Attributes:
        rmse: root mean square residual, radiance.
        relative_rmse: rmse over the rms radiance, of all usable values: saturated ones count where the model lies
            below the clip, outliers count.
        relative_rmse_trimmed: the same without outliers; where there are none, the very same.
        reduced_chi2: sum of squared residuals in units of the noise variance, per degree of freedom.
        samples: usable samples (pixels of all images); those with a saturated channel come on top, its value as a lower
            bound of the radiance.
        samples_used: usable samples that the final pass read.
        outliers: share of the values left out because they lie too far from the model.
        values_left_out: number of these values.
        iterations: evaluations over all samples (all from one pass where the model separates).
        status: "converged" or "not converged".
        message: how the fit went, as a sentence.
        errors: how the error bars were made: "fisher", "jackknife over images" ("lights" where images repeat each
            other) or "jackknife over blocks".
    """

    rmse: float
    relative_rmse: float
    relative_rmse_trimmed: float
    reduced_chi2: float
    samples: int
    samples_used: int
    iterations: int
    status: str
    message: str
    errors: str
    outliers: float = 0.0
    values_left_out: int = 0


@dataclass(frozen=True)
class Candidate:
    """A model that `auto` tried.

    Attributes:
        model: its expression.
        score: misfit on what was left out, images or bands of them: the rms error of single values in units of the
            noise, over a sample even over angles; models are compared by it.
        relative_rmse: error on images left out, over all usable values, as in `Fit`.
        reason: why the model was chosen or not.
        chosen: whether it is the model of the estimate.
    """

    model: str
    score: float
    relative_rmse: float
    reason: str
    chosen: bool = False


@dataclass(frozen=True)
class Estimate:
    """The estimated material of a capture, with everything a report needs.

    Attributes:
        capture: name of the capture.
        model: expression of the model.
        material: the model at the estimated values.
        parameters: by name (in a sum: by path).
        labels: names of the rows of `correlation`.
        correlation: of the estimates, [P][P].
        fit: quality of the fit.
        relative: the common scale of the lights is unknown, and that of albedo-like parameters with it.
        candidates: models tried by `auto`.
        nuisance: errors of the calibration that were refined or allowed for, by family.
        diagnosis: causes of residuals, the one that explains most first; empty where they are random.
        images: how well each fitted photograph is described, in their order; empty for a table.
        maps: values at every pixel, by name of the parameter; `parameters` then has their means.
        smooth_maps: the same smoothed between edges, where that was asked for.
        skipped: what was not computed, and why: components, samples, work.
        timing_s: seconds per stage.
        holdout: images left out of the fit and the error there.
        provenance: version, command, hashes of the inputs.
        warnings: sentences.
        channel_labels: names of the channels; empty: R, G, B, or numbers.
        residual_scale: by which outliers were judged.
        misreading: the mistake in the description of the capture that explains a gross misfit.
        residuals: of some samples by "half angle" and "angle of incidence"; empty for a table.
    """

    capture: str
    model: str
    material: Brdf
    parameters: dict[str, ParameterEstimate]
    labels: list[str]
    correlation: list[list[float]]
    fit: Fit
    relative: bool
    candidates: list[Candidate] = field(default_factory=list)
    nuisance: dict[str, NuisanceEstimate] = field(default_factory=dict)
    diagnosis: list[Diagnosis] = field(default_factory=list)
    images: list[PhotographFit] = field(default_factory=list)
    maps: dict[str, ParameterMap] = field(default_factory=dict)
    smooth_maps: dict[str, ParameterMap] = field(default_factory=dict)
    skipped: dict[str, Any] = field(default_factory=dict)
    timing_s: dict[str, float] = field(default_factory=dict)
    holdout: dict[str, Any] | None = None
    provenance: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    channel_labels: tuple[str, ...] = ()
    residual_scale: ResidualScale = NOISE_ALONE
    misreading: Misreading | None = None
    residuals: Mapping[str, AngularResiduals] = field(default_factory=dict)

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={p.value} ± {p.std} ({p.status})" for name, p in self.parameters.items())
        return f"Estimate({self.capture}: {self.model}, {values})"

    @property
    def channels(self) -> int:
        """Number of channels of the parameters; 1 if no parameter has one value per channel."""
        return max((len(p.value) for p in self.parameters.values() if isinstance(p.value, list)), default=1)

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of the channels as people read them."""
        return self.channel_labels or channel_names(self.channels)

    @property
    def label_names(self) -> list[str]:
        """`labels` as people read them: `albedo G` for `albedo[1]`."""
        spoken = {
            f"{name}[{place}]": f"{name} {channel}"
            for name, parameter in self.parameters.items()
            if isinstance(parameter.value, list)
            for place, channel in enumerate(self.channel_names)
        }
        return [spoken.get(label, label) for label in self.labels]

    def to_dict(self) -> dict[str, Any]:
        """The content of `result.json`."""
        out: dict[str, Any] = {
            "schema": SCHEMA,
            "capture": self.capture,
            "model": self.model,
            "radiometry": "relative" if self.relative else "absolute",
            "parameters": {name: asdict(parameter) for name, parameter in self.parameters.items()},
            "correlation": {"names": self.labels, "matrix": self.correlation},
            "fit": asdict(self.fit),
            "candidates": [asdict(candidate) for candidate in self.candidates],
            "nuisance": {name: asdict(errors) for name, errors in self.nuisance.items()},
            "diagnosis": [asdict(cause) for cause in self.diagnosis],
            "images": [asdict(image) for image in self.images],
            "maps": {
                name: {
                    "value": map_file(name),
                    "std": map_file(name, "std"),
                    "determined": each.determined,
                    "shares": {status.name.lower().replace("_", " "): each.shares[status] for status in each.shares},
                    **{kind: map_file(name, kind) for kind in ("smooth", "smooth_std") if name in self.smooth_maps},
                }
                for name, each in self.maps.items()
            },
            "skipped": self.skipped,
        }
        if self.holdout is not None:
            out["holdout"] = self.holdout
        # What differs between two runs comes last: the time and, at the end of the provenance, the command line.
        return out | {"warnings": self.warnings, "provenance": self.provenance, "timing_s": self.timing_s}

    def material_dict(self) -> dict[str, Any]:
        """The content of `material.json`: the model and the values that shading needs.

        Values that the images do not determine are those of the best fit; `not_determined` names them.
        """
        means = {name: each.mean for name, each in self.maps.items()}
        values = {name: means.get(name, value).tolist() for name, value in self.material.parameters.items()}
        radiometry = "relative" if self.relative else "absolute"
        not_determined = [name for name, parameter in self.parameters.items() if parameter.status == "not determined"]
        return {"model": self.model, "radiometry": radiometry, "parameters": values, "not_determined": not_determined}


def material_is_relative(path: str | Path) -> bool:
    """Whether a stored material was estimated under lights of unknown scale: its albedo then has an unknown scale."""
    return _read_material(path).get("radiometry") == "relative"


def not_determined(path: str | Path) -> list[str]:
    """Parameters of a stored material that its data do not determine."""
    names = _read_material(path).get("not_determined", [])
    return [str(name) for name in names] if isinstance(names, list) else []


def load_material(path: str | Path) -> Brdf:
    """The material of a result folder (or of its `material.json`), ready for shading.

    Raises:
        InputError: no such file, or a file that cannot be read.
    """
    content = _read_material(path)
    try:
        brdf, _ = model(content["model"])
        # Under relative radiometry an albedo may exceed 1: `replace` does not check tensors.
        if others := [key for key, value in content["parameters"].items() if not _is_value(value)]:
            raise InputError(f"{others[0]} must be a number or a list of one number per channel; estimate it again.")
        values = {key: torch.as_tensor(value, dtype=torch.float64) for key, value in content["parameters"].items()}
        # Squares of what is shaded with it must stay within single precision.
        if beyond := [key for key, value in values.items() if not bool(value.float().square().isfinite().all())]:
            raise InputError(f"{beyond[0]} is {content['parameters'][beyond[0]]}; estimate it again.")
        for key in values.keys() & brdf.declared.keys():
            declared, value = brdf.declared[key], values[key]
            # Under relative radiometry an albedo may exceed 1; rounding is no fault.
            upper = math.inf if key in brdf.structure.amplitudes else declared.domain.upper
            if not bool(((value >= declared.domain.lower - _ROUNDING) & (value <= upper + _ROUNDING)).all()):
                raise InputError(f"{key} must lie in {declared.domain}; got {value.tolist()}. Estimate it again.")
        return brdf.replace(values)
    except InputError as error:
        raise InputError(f"{_material_file(path)}: expected a material of 'matest estimate'; {error}") from None
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        file = _material_file(path)
        raise InputError(f"{file}: expected a material of 'matest estimate'; cannot read it ({error}).") from None


def _is_value(value: Any) -> bool:
    """Whether JSON holds a parameter: a number, or a list of them. True and false are none."""
    numbers = value if isinstance(value, list) else [value]
    return bool(numbers) and all(type(number) in (int, float) for number in numbers)


def _material_file(path: str | Path) -> Path:
    path = Path(path)
    return path / "material.json" if path.is_dir() else path


def _read_material(path: str | Path) -> dict[str, Any]:
    file = _material_file(path)
    if not file.is_file():
        # The result of several captures, or of several objects, is a folder of folders.
        within = sorted(Path(path).glob("*/material.json"))
        names = ", ".join(one.parent.name for one in within)
        mend = f"it holds those of {names}: name one" if within else "check the path"
        raise InputError(f"{path}: expected a result folder of 'matest estimate', with a material.json; {mend}.")
    try:
        content = json.loads(file.read_text("utf-8"))
        _ = content["model"], content["parameters"].items()
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"{file}: expected a material of 'matest estimate'; cannot read it ({error}).") from None
    return content


def read_result(folder: Path) -> dict[str, Any]:
    """The content of the `result.json` of a result folder.

    Raises:
        InputError: no such file, or one that cannot be read.
    """
    file = folder / "result.json"
    if not file.is_file():
        raise InputError(f"{file}: no such file; expected a result folder of 'matest estimate'; check the path.")
    try:
        content = json.loads(file.read_text("utf-8"))
        _check_result(content)
    except (ValueError, OverflowError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"{file}: expected the result of 'matest estimate'; cannot read it ({error!r}).") from None
    return content


def _check_result(content: dict[str, Any]) -> None:
    """Refuse a result whose standard errors are no numbers, or whose paths are no text.

    Raises:
        ValueError, OverflowError, KeyError, TypeError, AttributeError: something is missing or wrong.
    """
    for name, parameter in content["parameters"].items():
        std = parameter.get("std")
        # Of some channels none is known.
        values = std if isinstance(std, list) else [std]
        if not all(value is None or math.isfinite(value) for value in values):
            raise ValueError(f"the standard error of {name} is {std}")
    for key in ("capture", "root"):
        if not isinstance(content["provenance"].get(key), str | None):
            raise TypeError(f"provenance.{key} is no path")
