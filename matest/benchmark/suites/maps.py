"""Maps: what they cost, how right values and error bars of single pixels are, and Adam with a value at every pixel."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rich.console import Group, RenderableType
from rich.text import Text
from torch import Tensor

import matest
from matest.benchmark.instruments import map_intervals
from matest.benchmark.instruments.map_intervals import GROUPS, IMAGES, OBJECTS, SMOOTH, TWO_MATERIALS, Setting
from matest.benchmark.instruments.photographs import in_files, sphere
from matest.benchmark.instruments.varying import KINDS, estimated, known_to, photographed, relative_errors
from matest.benchmark.rivals.adam_of_maps import MapContest, descend
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.suites.command import cost_of, forget_noise
from matest.benchmark.suites.scaling import power_law, spheres
from matest.benchmark.tables import by_case, case_name, figure, limit, page, ruled
from matest.brdf import Brdf
from matest.estimation.result import Estimate
from matest.workers import processes

# Model of the captures that costs are of, and the most that the whole command with each of these maps may take, in
# times of decoding.
MODEL = "oren-nayar"
COSTS = {"albedo": 3.0, "albedo,sigma": 10.0}
# Megabytes of memory of the whole command, at most.
_PEAK_LIMIT = 1500.0
# Most that the exponent of time in pixels may be.
_EXPONENT_LIMIT = 1.05
# Kinds of material whose errors are measured, and the relative standard error below which a shape counts as known: the
# target for a slope, and one that a tenth of the pixels reach for σ.
KNOWN = {"cook-torrance": 0.015, "oren-nayar": 0.055}
# Kind whose errors have limits, and that Adam is raced on.
JUDGED = "cook-torrance"
# The median error among pixels whose shape is known, at most, relative.
_MEDIAN_LIMIT = 0.01
# An error that no such pixel should have, relative, and the share of those that may.
FAR = 0.05
_FAR_LIMIT = 0.01


class Rules(NamedTuple):
    """How Adam is raced.

    Attributes:
        side: pixels on a side of the images.
        rates: its learning rates.
        steps: of a run, at most.
        patience: processor seconds of a run, at most.
    """

    side: int
    rates: tuple[float, ...]
    steps: int
    patience: float = math.inf


@dataclass(frozen=True)
class Size:
    """How much is measured.

    Attributes:
        command: pixels on a side of the photographs that the whole command reads.
        costs: the maps that it makes.
        judged: whether limits of cost hold.
        growing: pixels on a side of the series of sizes.
        accurate: of the captures that errors are of.
        shapes: objects of these.
        covered: of those that intervals are counted in.
        captures: that these are counted in.
        settings: of them.
        race: with Adam.
    """

    command: int
    costs: tuple[str, ...]
    judged: bool
    growing: tuple[int, ...]
    accurate: int
    shapes: tuple[str, ...]
    covered: int
    captures: int
    settings: tuple[Setting, ...]
    race: Rules


FULL = Size(
    command=1024,
    costs=tuple(COSTS),
    judged=True,
    growing=(128, 256, 512, 1024),
    accurate=256,
    shapes=tuple(OBJECTS),
    covered=96,
    captures=100,
    settings=(*SMOOTH, *TWO_MATERIALS),
    race=Rules(256, (0.1, 0.03, 0.3), 1000),
)
# In the run of all suites.
SHARED = replace(FULL, growing=(128, 256, 512), race=Rules(96, (0.1, 0.03), 500, patience=60.0))
QUICK = Size(
    command=128,
    costs=("albedo,sigma",),
    judged=False,
    growing=(32, 64),
    accurate=48,
    shapes=("sphere",),
    covered=32,
    captures=1,
    settings=(SMOOTH[0], TWO_MATERIALS[-1]),
    race=Rules(32, (0.1,), 20),
)


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of costs, errors, the race and intervals."""
    size = QUICK if effort.quick else SHARED if effort.shared else FULL
    yield from costs(size, progress)
    yield from growth(size, progress)
    for shape in size.shapes:
        for name in KNOWN:
            yield from accuracy(shape, name, size, progress)
    if effort.races("adam"):
        yield from race(size.race, progress)
    yield from intervals(size, effort, progress)


def costs(size: Size, progress: Progress) -> Iterator[Record]:
    """What the whole command takes, noise not stated."""
    if not Path("/proc/self/status").exists():
        note = "the peak memory of a process is only known on Linux"
        yield Record("maps", f"{IMAGES} × {size.command}²", "peak", None, "MB", limit=_PEAK_LIMIT, note=note)
        return
    with in_files(MODEL, images=IMAGES, size=size.command) as folder:
        forget_noise(folder / "capture.toml")
        for names in size.costs:
            progress(f"whole command, --maps {names}")
            cost, case = cost_of(folder, "--model", MODEL, "--maps", names), f"{IMAGES} × {size.command}²: {names}"
            for metric, seconds in (("decode", cost.decode), ("imports", cost.imports), ("command", cost.command)):
                yield Record("maps", case, metric, seconds, "s")
            yield Record("maps", case, "peak", cost.peak, "MB", limit=_PEAK_LIMIT)
            if size.judged:
                times, most = cost.ratio, COSTS[names]
                yield Record("maps", case, "command / decode", times, "1", limit=most, note=cost.account)


def growth(size: Size, progress: Progress) -> Iterator[Record]:
    """Time of estimates of more and more pixels, and the exponent of its growth."""
    for names in size.costs:
        case, times = f"growth: {names}", {}
        for number, side in enumerate(size.growing):
            progress(case, number, len(size.growing))
            capture = spheres(MODEL, IMAGES, side)
            _, times[len(capture.scene.surface)] = processed(partial(matest.estimate, capture, MODEL, maps=names))
        for pixels, seconds in times.items():
            yield Record("maps", case, f"time of {pixels:,}", seconds, "s")
        law = power_law(list(times), list(times.values()))
        most = _EXPONENT_LIMIT if size.judged else None
        yield Record("maps", case, "exponent", float(law.slope), "1", limit=most, note=f"exponent ± {law.stderr:.2f}")
        yield Record("maps", case, "exponent, standard error", float(law.stderr), "1")


def processed(estimate: Callable[[], Estimate]) -> tuple[Estimate, float]:
    """An estimate, and the processor seconds that it takes."""
    start = time.process_time()
    return estimate(), time.process_time() - start


def accuracy(shape: str, name: str, size: Size, progress: Progress) -> Iterator[Record]:
    """Errors of the pixels of one capture whose shape is known."""
    case, kind = f"errors, {shape}: {name}", KINDS[name]
    progress(case)
    subject = photographed(kind, OBJECTS[shape](size.accurate), IMAGES, seed=0)
    estimate, seconds = processed(partial(estimated, kind, subject.photograph()))
    known = known_to(estimate.maps[kind.shape], KNOWN[name])
    yield Record("maps", case, "matest", seconds, "s")
    yield Record("maps", case, "pixels", len(known), "1", "higher")
    yield Record("maps", case, "known", int(known.sum()), "1", "higher")
    yield Record("maps", case, "reduced chi2", estimate.fit.reduced_chi2, "1")
    values = {mapped: each.value for mapped, each in estimate.maps.items()}
    yield from errors(case, "matest", values, subject.material, known, judged=size.judged and name == JUDGED)


def errors(
    case: str, who: str, values: Mapping[str, Tensor], truth: Brdf, known: Tensor, *, judged: bool
) -> Iterator[Record]:
    """The median error of maps among some pixels, and the share of those that are far off."""
    for name, value in values.items():
        off = relative_errors(value, truth.parameters[name])[known]
        median, far = (float(off.median()), float((off > FAR).double().mean())) if len(off) else (None, None)
        note = "" if len(off) else "no pixel's shape is known so well"
        for metric, share, most in (("median error", median, _MEDIAN_LIMIT), ("far off", far, _FAR_LIMIT)):
            bound = most if judged else None
            yield Record("maps", case, f"{who}, {name}: {metric}", share, "1", limit=bound, note=note)


def race(rules: Rules, progress: Progress) -> Iterator[Record]:
    """Errors of Adam at the pixels that are known, and its time; the learning rate with the lowest loss counts."""
    case, kind = f"race, {rules.side}²: {JUDGED}", KINDS[JUDGED]
    subject = photographed(kind, sphere(rules.side), IMAGES, seed=0)
    capture = subject.photograph()
    estimate, seconds = processed(partial(estimated, kind, capture))
    known = known_to(estimate.maps[kind.shape], KNOWN[JUDGED])
    contest, runs = MapContest.of(kind, capture, subject.material), []
    for rate in rules.rates:
        progress(f"adam, learning rate {rate:g}")
        runs.append(descend(contest, rate, rules.steps, rules.patience))
    best = min(runs, key=lambda run: run.loss)
    yield Record("maps", case, "pixels", len(known), "1", "higher")
    yield Record("maps", case, "known", int(known.sum()), "1", "higher")
    yield Record("maps", case, "matest", seconds, "s")
    yield Record("maps", case, "adam", best.seconds, "s", note=best.account)
    yield Record("maps", case, "adam / matest", best.seconds / seconds, "1", "higher", note=best.account)
    maps = {name: each.value for name, each in estimate.maps.items()}
    for who, values in (("matest", maps), ("adam", {name: best.values[name] for name in maps})):
        yield from errors(case, who, values, subject.material, known, judged=False)


def intervals(size: Size, effort: Effort, progress: Progress) -> Iterator[Record]:
    """How often 95 % intervals hold the truth, over captures that are drawn anew."""
    captures = size.captures
    with processes(captures) as pool:
        for setting in size.settings:
            some, end = [], time.perf_counter() + effort.seconds / len(size.settings)
            for one in pool.map(map_intervals.trial, [setting] * captures, [size.covered] * captures, range(captures)):
                some.append(one)
                progress(setting.case, len(some), captures)
                if time.perf_counter() > end:
                    break
            yield from map_intervals.records("maps", f"intervals, {setting.case}", some)


def table(records: Sequence[Record]) -> Group:
    """Costs, errors and coverage, each in a table of its own."""
    cases = by_case(records)
    about = (
        f"Maps from {IMAGES} photographs; times in processor seconds. The whole command with --model {MODEL}, noise "
        "not stated, without imports; growth of estimates of captures in memory. Errors, relative: of objects whose "
        "albedo and slope or σ vary smoothly, among the pixels whose slope is said to be known to "
        f"{100 * KNOWN['cook-torrance']:g} %, σ to {100 * KNOWN['oren-nayar']:g} %; off: share of these off by more "
        f"than {100 * FAR:g} %. Adam: per-pixel parameters of the same shader, all samples a step."
    )
    parts: list[RenderableType] = []
    for part in (_costs(cases), *_growth(cases), _errors(cases), *_race(cases), _coverage(cases)):
        parts += [part, ""]
    legend = (
        "own: pixels that tell their own value; all: all that are seen; shared: what all pixels share, with the rms of "
        f"its errors in standard errors. Limits {map_intervals.LIMITS[0]:g} to {map_intervals.LIMITS[1]:g}. χ²: mean "
        "and largest, per degree of freedom."
    )
    return page(about, *parts, Text(legend), records=records)


Cases = Mapping[str, Mapping[str, Record]]


def _costs(cases: Cases) -> RenderableType:
    costs = ruled("", "decode", "command", "peak MB", "command\n/ decode", "limit")
    for case, metrics in cases.items():
        if "peak" in metrics:
            ratio = metrics.get("command / decode")
            numbers = (figure(metrics.get(name)) for name in ("decode", "command", "peak"))
            costs.add_row(case_name(case), *numbers, figure(ratio), "" if ratio is None else limit(ratio))
    return costs


def _growth(cases: Cases) -> Iterator[RenderableType]:
    for case, metrics in cases.items():
        if "exponent" in metrics:
            times = {name.removeprefix("time of "): one for name, one in metrics.items() if name.startswith("time of ")}
            growth, exponent = ruled(case, *times, "exponent", "limit"), metrics["exponent"]
            growth.add_row("  seconds", *map(figure, times.values()), figure(exponent), limit(exponent))
            yield growth


def _errors(cases: Cases) -> RenderableType:
    errors = ruled("errors", "pixels", "known", "χ²", "seconds", "median", "off")
    for case, metrics in cases.items():
        if "known" not in metrics:
            continue
        whole = (figure(metrics.get(name)) for name in ("pixels", "known", "reduced chi2"))
        errors.add_row(case_name(case.removeprefix("errors, ")), *whole)
        for metric in metrics:
            who, _, name = metric.removesuffix(": far off").partition(", ")
            if metric.endswith(": far off"):
                pair = (figure(metrics[f"{who}, {name}: {one}"]) for one in ("median error", "far off"))
                errors.add_row(f"  {who}, {name}", "", "", "", figure(metrics[who]), *pair)
    return errors


def _race(cases: Cases) -> Iterator[RenderableType]:
    for case, metrics in cases.items():
        if "adam / matest" in metrics:
            ratio, account = figure(metrics["adam / matest"]).plain, metrics["adam"].note
            yield Text(f"{case}: Adam takes {ratio} times as long as matest{f': {account}' if account else ''}.")


def _coverage(cases: Cases) -> RenderableType:
    shares = ruled("95 % intervals", *GROUPS, "error\n/ std", "χ²", "largest", "cap-\ntures")
    for case, metrics in cases.items():
        if "captures" not in metrics:
            continue
        whole = (figure(metrics[name]) for name in ("mean reduced chi2", "largest reduced chi2", "captures"))
        shares.add_row(case_name(case.removeprefix("intervals, ")), *[""] * (len(GROUPS) + 1), *whole)
        names = (metric.rpartition(", ")[0] for metric in metrics if metric.endswith(": coverage"))
        for name in dict.fromkeys(names):
            cells = (_covered(metrics, f"{name}, {group}: coverage") for group in GROUPS)
            shares.add_row(f"  {name}", *cells, figure(metrics.get(f"{name}: rms error / std")))
    return shares


def _covered(metrics: Mapping[str, Record], metric: str) -> Text:
    """A coverage, red beyond either of its limits."""
    shown, above = figure(metrics.get(metric)), metrics.get(f"{metric}, not above")
    return Text(shown.plain, style="red") if above is not None and above.misses else shown


SUITE = Suite(measure, table, share=30)
