"""The records of a suite as tables that fit 80 columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from matest.benchmark.suite import Record


def page(about: str, *parts: RenderableType, records: Sequence[Record]) -> Group:
    """The page of a suite: a paragraph, tables, and the records that miss a limit or have no value."""
    return Group(Text(about), "", *parts, *notes(records))


def by_case(records: Sequence[Record]) -> dict[str, dict[str, Record]]:
    """Records by case and metric."""
    cases: dict[str, dict[str, Record]] = {}
    for record in records:
        cases.setdefault(record.case, {})[record.metric] = record
    return cases


def ruled(names: str, *columns: str) -> Table:
    """An empty table: names on the left, figures in the columns."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column(names, no_wrap=True)
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    return table


def listed(names: str, metrics: Sequence[str], cases: Mapping[str, Mapping[str, Record]]) -> Table:
    """A table with one row per case and one column per metric."""
    table = ruled(names, *metrics)
    for case, by_metric in cases.items():
        table.add_row(case_name(case), *(figure(by_metric.get(metric)) for metric in metrics))
    return table


def case_name(case: str) -> Text:
    """The expression of a model, with its options on a second line."""
    return Text(case.replace("(", "\n  (", 1), style="bold")


def figure(record: Record | None) -> Text:
    """A value to three digits, red where it misses its limit; empty where there is none."""
    if record is None or record.value is None:
        return Text("")
    whole = isinstance(record.value, int) or 100 <= record.value < 1e6
    return Text(f"{record.value:,.0f}" if whole else f"{record.value:.3g}", style="red" if record.misses else "")


def limit(record: Record) -> str:
    """The limit of a figure; empty where there is none."""
    return "" if record.limit is None else f"{record.limit:g}"


def largest(records: Sequence[Record], metric: str) -> int:
    """The largest value of a metric over all cases."""
    return max(int(record.value or 0) for record in records if record.metric == metric)


def notes(records: Sequence[Record]) -> list[Text]:
    """The records that miss their limit or have no value, with their notes."""
    lines = [Text("")]
    for record in records:
        if record.misses or record.value is None:
            target = f" = {record.value:.4g}, limit {record.limit:g}" if record.misses else ""
            lines.append(Text(f"{record.case}: {record.metric}{target}", style="red"))
            lines += [Text(f"  {line}") for line in record.note.splitlines()]
    return lines
