"""Draw the benchmark into `renders/benchmark/`: `python renders/benchmark.py [RECORDS.jsonl...]`.

The records are what `matest benchmark --suite frontier --json` prints, one a line; without a file the suite is run,
which takes some minutes. Records of the suite `estimate` among them give the picture of its stages, those of `scaling`
that of how its time grows.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from papers.drawing import BLACK, BLUE, GREEN, ORANGE, PINK

HERE = Path(__file__).parent / "benchmark"
# Colour and marker of every estimator, the same in every panel.
STYLES = {
    "matest": (ORANGE, "o"),
    "levenberg-marquardt": (BLACK, "s"),
    "dr.jit": (GREEN, "D"),
    "l-bfgs": (BLUE, "^"),
    "least_squares": ("#56B4E9", "v"),
    "adam": (PINK, "P"),
    "adam, mini-batches": ("#8C6BB1", "X"),
    "mitsuba": ("#999999", "*"),
}
NAMES = {
    "levenberg-marquardt": "Levenberg-Marquardt by hand, torch",
    "dr.jit": "Levenberg-Marquardt by hand, Dr.Jit",
    "l-bfgs": "L-BFGS, torch",
    "least_squares": "scipy least_squares",
    "adam": "Adam, all samples",
    "adam, mini-batches": "Adam, mini-batches",
    "mitsuba": "Mitsuba 3's tutorial",
}
STAGES = {"decode": "#999999", "geometry": "#56B4E9", "fit": ORANGE}
# Errors far above those that anyone would take for a result.
_WORST = 1e5
Records = list[dict]


def main(files: list[str]) -> None:
    """Draw what the records hold."""
    records = [json.loads(line) for file in files for line in Path(file).read_text("utf-8").splitlines()]
    if not files:
        from matest.benchmark import Effort, load

        for record in load("frontier").run(Effort(), lambda word, *_: print(word, flush=True)):
            records.append(record.to_dict())
    HERE.mkdir(exist_ok=True)
    for suite, (name, draw) in PICTURES.items():
        chosen = [record for record in records if record["suite"] == suite]
        if chosen:
            FigureCanvasAgg(draw(chosen)).print_png(HERE / f"{name}.png")
            print(f"benchmark/{name}.png", flush=True)


def frontier(records: Records) -> Figure:
    """Error against time, a panel a scene."""
    cases = list(dict.fromkeys(record["case"] for record in records))
    rows = (len(cases) + 1) // 2
    figure = Figure(figsize=(10, 3.7 * rows + 1.1), layout="constrained")
    drawn: dict[str, object] = {}
    for number, case in enumerate(cases):
        axes = figure.add_subplot(rows, 2, number + 1)
        metrics = {record["metric"]: record["value"] for record in records if record["case"] == case}
        drawn |= _panel(axes, metrics)
        axes.set_title(f"{case} ({metrics['samples']:,} samples)", fontsize=10)
        axes.set_xlabel("seconds")
        if number % 2 == 0:
            axes.set_ylabel("error / Cramér-Rao bound")
    known = [estimator for estimator in STYLES if estimator in drawn]
    figure.legend(
        [drawn[estimator] for estimator in known],
        [NAMES.get(estimator, estimator) for estimator in known],
        loc="outside lower center",
        ncols=3,
        frameon=False,
    )
    return figure


def _panel(axes: Axes, metrics: dict[str, float]) -> dict[str, object]:
    """The curves of one scene: what was drawn, by estimator."""
    drawn = {}
    for estimator, (colour, marker) in STYLES.items():
        points = curve(metrics, estimator)
        if not points:
            continue
        seconds, errors = zip(*points, strict=True)
        own = estimator == "matest"
        (drawn[estimator],) = axes.plot(
            seconds,
            errors,
            color=colour,
            marker=marker,
            markersize=7 if own else 4,
            linewidth=2.6 if own else 1.2,
            markevery=1 if own else max(len(points) // 8, 1),
            zorder=3 if own else 2,
            drawstyle="steps-post",
        )
    axes.axhline(1, color=BLACK, linewidth=0.8, linestyle=":")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(top=min(axes.get_ylim()[1], _WORST))
    axes.grid(alpha=0.25)
    return drawn


def curve(metrics: dict[str, float], estimator: str) -> list[tuple[float, float]]:
    """The points of an estimator: seconds and error."""
    points = []
    while (seconds := metrics.get(f"{estimator}: point {len(points)}, seconds")) is not None:
        points.append((seconds, metrics[f"{estimator}: point {len(points)}, error"]))
    return points


def stages(records: Records) -> Figure:
    """Seconds of every stage of an estimate beside those of decoding its photographs, a bar a model."""
    cases = list(dict.fromkeys(record["case"] for record in records))
    values = {(record["case"], record["metric"]): record["value"] for record in records}
    figure = Figure(figsize=(8, 0.7 * len(cases) + 1.4), layout="constrained")
    axes = figure.add_subplot()
    left = [0.0] * len(cases)
    for stage, colour in STAGES.items():
        widths = [values[case, stage] for case in cases]
        axes.barh(cases, widths, left=left, color=colour, label=stage)
        left = [a + b for a, b in zip(left, widths, strict=True)]
    axes.invert_yaxis()
    axes.set_xlabel("seconds, 12 photographs")
    figure.legend(loc="outside lower center", ncols=len(STAGES), frameon=False)
    return figure


def growth(records: Records) -> Figure:
    """Seconds of an estimate against what grows, a line for each."""
    figure = Figure(figsize=(6, 4.2), layout="constrained")
    axes = figure.add_subplot()
    for case in dict.fromkeys(record["case"] for record in records):
        times = [
            (int(record["metric"].removeprefix("time of ").replace(",", "")), record["value"])
            for record in records
            if record["case"] == case and record["metric"].startswith("time of ")
        ]
        if times:
            sizes, seconds = zip(*sorted(times), strict=True)
            axes.plot([size / sizes[0] for size in sizes], seconds, marker="o", label=f"{case}, from {sizes[0]:,}")
    axes.set_xscale("log", base=2)
    axes.set_yscale("log", base=2)
    axes.set_xlabel("times as many")
    axes.set_ylabel("seconds")
    axes.grid(alpha=0.25)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


# What is drawn of each suite, and by whom.
PICTURES = {"frontier": ("frontier", frontier), "estimate": ("stages", stages), "scaling": ("growth", growth)}

if __name__ == "__main__":
    main(sys.argv[1:])
