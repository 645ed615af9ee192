"""Numbers as people read them: a value with as many digits as its error bar allows, angles with degrees beside."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from matest.estimation.parameter_map import ParameterMap, TexelStatus
from matest.estimation.result import Candidate
from matest.estimation.table_fit import Misfit
from matest.inference.quantities import ParameterEstimate

# What page and terminal call the same columns and tables.
PARAMETER_COLUMNS = ("parameter", "value ± standard error", "95 % interval", "status")
MISFIT_COLUMNS = ("values", "relative rms error", "error of cube roots", "relative to them")
CANDIDATES_TITLE = "Models tried, and their errors on what was left out"
CANDIDATE_COLUMNS = ("model", "× noise", "relative", "verdict")
CANDIDATES_LEGEND = (
    "× noise: rms error of single values, by which models are compared, every angle counting alike; relative: rms "
    "error over rms signal, every value counting alike. Left out in turn: images; of one or two images four horizontal "
    "bands of each; of a measured table incidences (polar angles of the light)."
)
# What people read of the pixels of a map.
STATUSES = {
    TexelStatus.DETERMINED: "determined",
    TexelStatus.AT_BOUND: "at a bound",
    TexelStatus.SHARED: "not told by their own photographs",
    TexelStatus.UNSEEN: "not seen",
}
# Relative error from which on a multiple is read more easily than per cent.
_LARGE_SHARE = 10.0
# Relative error that says no more than a larger one.
_HOPELESS = 100.0


def measured(value: float | None, std: float | None) -> str:
    """`0.5236 ± 0.0012`; the value alone without an error bar; `-` without a value."""
    if value is None:
        return "-"
    if std is None or not math.isfinite(std):
        return f"{value:.4g}"
    if std == 0:
        return f"{value:.6g} ± 0"
    digits = _decimals(std)
    return f"{value:z.{digits}f} ± {std:.{digits}f}"


def rows(name: str, parameter: ParameterEstimate, channels: tuple[str, ...]) -> list[tuple[str, str, str, str]]:
    """Table rows (name, value ± error, 95 % interval, status) of a parameter: one, or one per channel."""
    value, std, interval = parameter.value, parameter.std, parameter.interval95
    if not isinstance(value, list):
        single = std if isinstance(std, float) else None
        return [(name, *_cells(value, single, interval, parameter.unit), parameter.status)]
    stds = std if isinstance(std, list) else [None] * len(value)
    intervals = interval or [None] * len(value)
    return [
        (f"{name} {channel}", *_cells(one, error, span, parameter.unit), _state(parameter.status, one, error))
        for channel, one, error, span in zip(channels, value, stds, intervals, strict=False)
    ]


def _state(status: str, value: float | None, std: float | None) -> str:
    """The status of one channel; that of the parameter is the worst of its channels'."""
    if status in ("fixed", "tied"):
        return status
    return "not determined" if value is None else "at bound" if std is None else "determined"


def candidate_cells(candidate: Candidate) -> tuple[str, str, str, str]:
    """Cells of `CANDIDATE_COLUMNS`."""
    verdict = f"{'chosen: ' * candidate.chosen}{candidate.reason}"
    return candidate.model, f"{candidate.score:.3g}", share(candidate.relative_rmse), verdict


def misfit_cells(misfit: Misfit) -> tuple[str, str, str, str]:
    """Cells of `MISFIT_COLUMNS`."""
    return (
        f"{misfit.values:,}",
        share(misfit.relative_rmse),
        f"{misfit.cube_root_error:.4f}",
        share(misfit.relative_cube_root_error),
    )


def share(value: float | None) -> str:
    """A relative error in per cent, as a multiple (`81.2 ×`) where it is large, or that there is none."""
    if value is None:
        return "no usable pixel"
    return f"{value:.2%}" if value < _LARGE_SHARE else f"{value:.3g} ×"


def chi2(value: float) -> str:
    """Reduced χ²: two decimals near 1, three digits far from it."""
    return f"{value:.2f}" if value < 100 else f"{value:.3g}"


def status_sentences(maps: Mapping[str, ParameterMap]) -> list[str]:
    """What share of the object's pixels each map tells, a sentence each."""
    return [f"Map of {name}: {_shares(each)}." for name, each in maps.items()]


def _shares(each: ParameterMap) -> str:
    """`determined at 93.1% of the object's pixels, not seen at 6.9%`."""
    present = {STATUSES[status]: each.shares[status] for status in STATUSES if each.shares[status]}
    texts = [f"{words} at {part:.1%}" if part >= 0.0005 else f"{words} at few" for words, part in present.items()]
    return ", ".join([f"{texts[0]} of the object's pixels", *texts[1:]]) if texts else "no pixel"


def stages(timing_s: Mapping[str, float]) -> str:
    """`read 0.03 s, fit 1.45 s`."""
    return ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in timing_s.items())


def _cells(value: float | None, std: float | None, interval: list[float] | None, unit: str) -> tuple[str, str]:
    if value is None:
        return "-", "-"
    if unit == "rad":
        degrees = [None if v is None else math.degrees(v) for v in (value, std)]
        span = "-" if interval is None else _span([math.degrees(end) for end in interval], "°")
        return f"{measured(value, std)} rad\n{measured(*degrees)} degrees", span
    suffix = "" if unit == "1" else f" {unit}"
    return measured(value, std) + suffix, "-" if interval is None else _span(interval, "")


def _span(ends: list[float], suffix: str) -> str:
    """An interval with as many digits as its width allows."""
    width = ends[1] - ends[0]
    digits = _decimals(width) if width > 0 and math.isfinite(width) else 6
    return " to ".join(f"{end:.{digits}f}{suffix}" for end in ends)


def _decimals(uncertainty: float) -> int:
    """Decimals that show two digits of an uncertainty, nine at most."""
    return min(max(1 - math.floor(math.log10(uncertainty)), 0), 9)


def percent(value: float | None) -> str:
    """A relative error in per cent with two digits; `-` where there is none."""
    if value is None:
        return "-"
    if value > _HOPELESS:
        return f"> {100 * _HOPELESS:.0f}%"
    return f"{100 * value:.2g}%" if value < 0.995 else f"{100 * value:.0f}%"


def short(name: str, names: Iterable[str]) -> str:
    """The last part of a path, unless another one has the same."""
    last = name.rpartition(".")[2]
    return name if sum(other.rpartition(".")[2] == last for other in names) > 1 else last


def listed(names: Sequence[str]) -> str:
    """`albedo, sigma and f0`."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)
