"""Which figures of a run are worse than the baseline by more than their tolerance, or missing.

`matest benchmark --gate` holds a run to all of them; `python -m matest.benchmark.gate records.jsonl` shows the records
of `matest benchmark --json` as tables and holds them to the accuracy alone, for machines that others use too.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence
from pathlib import Path

from rich.console import Console, Group, RenderableType
from rich.text import Text

from matest.benchmark import FIRST, SUITES, load
from matest.benchmark.baseline import Figure, is_quick, read, records_of, with_file
from matest.benchmark.suite import Record
from matest.benchmark.tables import case_name, ruled
from matest.errors import InputError

KINDS = ("accuracy", "cost")


# A figure of the baseline, and the value of the run; None: the run has no such value.
Worse = tuple[Figure, float | None]


def expected(quick: bool, suites: Collection[str], kinds: Collection[str] = KINDS) -> list[Figure]:
    """The figures of the baseline for some suites.

    Raises:
        InputError: a bad baseline, or one without figures of these suites.
    """
    figures = [figure for figure in read().of(quick) if figure.suite in suites and figure.kind in kinds]
    if not figures:
        run, names = "quick" if quick else "full", [name for name in suites if name in SUITES]
        raise InputError(
            f"tests/benchmark_baseline.json has no figures of a {run} run of {', '.join(names)}; write them with "
            "python -m matest.benchmark.baseline, or choose other suites."
        )
    return figures


def worse(figures: Sequence[Figure], records: Sequence[Record]) -> list[Worse]:
    """The figures that the records do not reach."""
    values = {(record.suite, record.case, record.metric): record.value for record in records}
    pairs = [(figure, values.get((figure.suite, figure.case, figure.metric))) for figure in figures]
    return [(figure, value) for figure, value in pairs if not figure.admits(value)]


def gate_table(figures: Sequence[Figure], failed: Sequence[Worse]) -> RenderableType:
    """Every figure that is worse, or one sentence if none is."""
    if not failed:
        return Text(f"Gate: none of {len(figures):,} figures is worse than the baseline by more than its tolerance.")
    table = ruled("", "baseline", "allowed", "now")
    for suite, case in dict.fromkeys((figure.suite, figure.case) for figure, _ in failed):
        table.add_row(Text(f"{suite}: ").append_text(case_name(case)))
        for figure, value in failed:
            if (figure.suite, figure.case) == (suite, case):
                now = Text("missing" if value is None else f"{value:.4g}", style="red")
                table.add_row(f"  {figure.metric}", f"{figure.value:.4g}", f"{figure.worst:.4g}", now)
    summary = (
        f"Gate: {len(failed):,} of {len(figures):,} figures are worse than the baseline by more than their tolerance."
    )
    return Group(Text(summary, style="red"), "", table)


def main(file: str) -> None:
    """Show the records in a file and hold their accuracy to the baseline; exit code 1 if any is worse or missing."""
    records = records_of(Path(file))
    figures = expected(is_quick(records), SUITES, ("accuracy",))
    terminal = Console(highlight=False)
    for name in (FIRST, *SUITES):
        if of_suite := [record for record in records if record.suite == name]:
            terminal.print(load(name).table(of_suite))
    failed = worse(figures, records)
    terminal.print(gate_table(figures, failed))
    if failed:
        sys.exit(1)


if __name__ == "__main__":
    with_file(main)
