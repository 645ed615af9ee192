"""The baseline that the gate holds a run to: accuracy and ratios of time or memory, each with its tolerance.

`matest benchmark --quick --json > records.jsonl` and then `python -m matest.benchmark.baseline records.jsonl` writes
the figures of quick runs anew, the same without `--quick` those of full runs; the diff in git shows what changed.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Literal, TypeVar

import msgspec

from matest.benchmark.suite import QUICK, Record
from matest.errors import InputError

PATH = Path("tests/benchmark_baseline.json")

Kind = Literal["accuracy", "cost"]
Content = TypeVar("Content")

# Figures of the baseline, by suite/metric. The tolerance is relative; None: the statistical error of the figure.
SELECTED: dict[str, tuple[Kind, float | None]] = {
    "stress/* non-finite *": ("accuracy", 0.0),
    # The points are the same on every machine, the last digits of its functions are not.
    "stress/float32 error": ("accuracy", 1.0),
    **{
        f"{suite}/{metric}": ("accuracy", None)
        for suite in ("efficiency", "outliers")
        for metric in ("given", "*rms error", "coverage", "optimum missed")
    },
    "export/*: error": ("accuracy", 0.05),
    # One capture, the same on every machine; of its few known pixels one more or less moves the median.
    "maps/matest, *: median error": ("accuracy", 0.5),
    "maps/known": ("accuracy", 0.3),
    "fuzz/faults": ("accuracy", 0.0),
    "faults/lost or partial": ("accuracy", 0.0),
    "models/tiled gradient": ("cost", 0.5),
    "models/time per pass": ("cost", 0.5),
    "models/* needed components": ("cost", 0.5),
    "estimate/fit / decode": ("cost", 0.5),
    # The race is to 1 %: a distance below that does not matter.
    "peers/distance": ("accuracy", 1.0),
    "peers/* / matest": ("cost", 0.5),
    "frontier/matest: error at the end": ("accuracy", 0.5),
    "frontier/* / matest": ("cost", 0.5),
    "scaling/exponent": ("cost", None),
    "scaling/time per sample": ("cost", 0.5),
    "start/estimate / *": ("cost", 0.3),
    "command/command / decode": ("cost", 0.5),
    "command/peak": ("cost", 0.2),
    "memory/peak ratio": ("cost", 0.2),
}


class Figure(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One figure of the baseline, named as its record, and by how much, relative, it may be worse.

    A cost, of time and memory, depends on the machine and what else it does; accuracy does not.
    """

    suite: str
    case: str
    metric: str
    value: float
    better: Literal["lower", "higher"]
    tolerance: float
    kind: Kind

    @property
    def worst(self) -> float:
        """The worst value that passes."""
        change = self.tolerance * abs(self.value)
        return self.value + change if self.better == "lower" else self.value - change

    def admits(self, value: float | None) -> bool:
        """Whether a value is as good; none is not, nor is NaN, with which every comparison is false."""
        return value is not None and (value <= self.worst if self.better == "lower" else value >= self.worst)


class Baseline(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The figures of quick and of full runs, which are of different sizes and not comparable."""

    quick: tuple[Figure, ...] = ()
    full: tuple[Figure, ...] = ()

    def of(self, quick: bool) -> tuple[Figure, ...]:
        return self.quick if quick else self.full


def read(path: Path = PATH) -> Baseline:
    """The baseline in a file.

    Raises:
        InputError: no such file, or a file of another form.
    """
    mend = "python -m matest.benchmark.baseline writes one from the records of 'matest benchmark --json'"
    return _decoded(_bytes(path, f"run in the root of a checkout, or {mend}"), Baseline, path, mend)


def write(baseline: Baseline, path: Path = PATH) -> None:
    """Write a baseline, one figure a line."""
    runs = []
    for run, figures in msgspec.to_builtins(baseline).items():
        lines = ",\n".join(f"  {json.dumps(figure, ensure_ascii=False)}" for figure in figures)
        runs.append(f' "{run}": [\n{lines}\n ]' if lines else f' "{run}": []')
    text = ",\n".join(runs)
    path.write_text(f"{{\n{text}\n}}\n", "utf-8")


def records_of(path: Path) -> list[Record]:
    """The records that `matest benchmark --json` has printed.

    Raises:
        InputError: no such file, or other content.
    """
    mend = "write it with 'matest benchmark --json > FILE'"
    return [_decoded(line, Record, path, mend) for line in _bytes(path, mend).splitlines() if line.strip()]


def with_file(command: Callable[[str], None]) -> None:
    """Run a command on the one file that the command line names; exit code 2 and a sentence on bad input."""
    arguments = sys.argv[1:]
    try:
        if len(arguments) != 1:
            raise InputError(
                f"expected one file, the output of 'matest benchmark --json'; got {len(arguments)} arguments."
            )
        command(arguments[0])
    except InputError as error:
        print(f"matest: {error}", file=sys.stderr)
        sys.exit(2)


def is_quick(records: Sequence[Record]) -> bool:
    """Whether records are of a quick run.

    Raises:
        InputError: the records do not say it.
    """
    for record in records:
        if (record.suite, record.metric) == ("limits", QUICK):
            return bool(record.value)
    raise InputError("expected all records of 'matest benchmark --json', from its first line; the limits are missing.")


def figures_of(records: Sequence[Record]) -> Iterator[Figure]:
    """The figures that `SELECTED` takes from records with a value, and their tolerances."""
    cases: dict[tuple[str, str], dict[str, float]] = {}
    measured = {(r.suite, r.case, r.metric): r for r in records if r.value is not None}.values()
    for record in measured:
        cases.setdefault((record.suite, record.case), {})[record.metric] = record.value or 0.0
    for record in measured:
        key = f"{record.suite}/{record.metric}"
        rule = next((rule for pattern, rule in SELECTED.items() if fnmatch(key, pattern)), None)
        if rule is not None:
            kind, fixed = rule
            tolerance = statistical(record, cases[record.suite, record.case]) if fixed is None else fixed
            numbers = _rounded(record.value or 0.0, 6), record.better, _rounded(tolerance, 3)
            yield Figure(record.suite, record.case, record.metric, *numbers, kind)


def statistical(record: Record, of_case: Mapping[str, float]) -> float:
    """The relative 95 % error, toward worse values, of a pooled error, a share, a number of captures or an exponent.

    `of_case` has all figures of its case by metric, the ends of its interval among them.
    """
    value, metric = record.value or 0.0, record.metric
    if not value:
        return 0.0
    if metric == "optimum missed":
        error = 1.96 * math.sqrt(value)
    elif metric == "exponent":
        error = 1.96 * of_case[f"{metric}, standard error"]
    elif record.better == "lower":
        error = of_case[f"{metric}, to"] - value
    else:
        # The rule of three: where none of n fails, the share that fails is below 3/n at 95 %.
        error = max(value - of_case.get(f"{metric}, from", value), 3 / of_case["parameters"])
    return error / abs(value)


def main(file: str) -> None:
    """Replace the figures of the baseline for the suites of a run, quick or full, by those of its records in a file."""
    records = records_of(Path(file))
    old = read() if PATH.exists() else Baseline()
    quick, measured = is_quick(records), {record.suite for record in records}
    run = "quick" if quick else "full"
    others = tuple(figure for figure in old.of(quick) if figure.suite not in measured)
    write(msgspec.structs.replace(old, **{run: (*others, *figures_of(records))}))
    print(f"Written to {PATH}: {run} runs")


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


def _bytes(path: Path, mend: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {(error.strerror or 'cannot be read').lower()}; {mend}.") from None


def _decoded(data: bytes, kind: type[Content], path: Path, mend: str) -> Content:
    try:
        return msgspec.json.decode(data, type=kind)
    except (msgspec.DecodeError, msgspec.ValidationError) as error:
        expected = "records" if kind is Record else "a baseline"
        raise InputError(f"{path}: expected {expected}, got something else ({error}); {mend}.") from None


if __name__ == "__main__":
    with_file(main)
