"""The records of a suite as a table that fits 80 columns."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from matest.benchmark.instruments import precision, table4
from matest.benchmark.instruments.timing import TILE
from matest.benchmark.record import Record
from matest.benchmark.suites import stress

_METRICS = ("forward time", "forward", "forward + backward time", "forward + backward", "gradient")
_PASSES = ("passes", "time per pass", "time of its own passes")


def models_table(records: list[Record]) -> Group:
    """Times of every model: tile by tile, in one call, compiled; then its element-wise passes; then Table 4."""
    cases = by_case(records)
    published = {case: cases.pop(case) for case in list(cases) if case.startswith(table4.CASE)}
    dropped = {case: cases.pop(case) for case in list(cases) if case.startswith(table4.WITHOUT)}
    threads = cases.pop("all")["threads"].value
    times = ruled("", "forward\nns", "forward\npasses", "+backward\nns", "+backward\npasses", "ratio")
    passes = ruled("", "passes", "time\nper pass", "time /\nown passes")
    for case, found in cases.items():
        times.add_row(case_name(case))
        for mode in ("tiled", "one call", "compiled"):
            row = [found.get(f"{mode} {metric}") for metric in _METRICS]
            if any(row):
                times.add_row(f"  {mode}", *map(figure, row))
        passes.add_row(case_name(case), *(figure(found[metric]) for metric in _PASSES))
    pairs = max(found["pairs"].value or 0 for found in cases.values())
    about = (
        f"{pairs:,} pairs of directions (a tenth for sums over facets), float32, threads: {threads}. "
        "Per pair: forward is the value, +backward also its gradient by the parameters, ratio the second to the first. "
        f"A pass is one element-wise product of two tensors, in the same tiles of {TILE:,} (tiled) or whole."
    )
    legend = (
        "Passes: numbers that operations write, per pair. Time per pass: tiled forward / (passes × the pass above). "
        "Own passes: the time of the same operations alone."
    )
    return Group(
        Text(about), "", times, "", Text(legend), "", passes, *table4_tables(published, dropped), *notes(records)
    )


def table4_tables(
    published: dict[str, dict[str, Record]], dropped: dict[str, dict[str, Record]]
) -> list[RenderableType]:
    """Cost of every model and the error of its fit, and what leaving out a component saves."""
    costs = ruled("Table 4", "paper", *table4.SAMPLES, "error\nof fit", "", "", "")
    unit = table4.PUBLISHED[table4.UNIT][0]
    for name, seconds in table4.PUBLISHED.items():
        found = published[f"{table4.CASE}{name}"]
        paper = " - ".join(f"{second / unit:.1f}" for second in dict.fromkeys(seconds))
        errors = [f"{found[f'{sample} error of fit'].value:.0%}" for sample in table4.SAMPLES]
        values = [found[f"{sample} cost"].value or 0.0 for sample in table4.SAMPLES]
        row = [f"{value:.2f}" if value < 10 else f"{value:,.0f}" for value in values]
        costs.add_row(case_name(name), paper, *row, *errors)
    ours = published[f"{table4.CASE}{table4.OURS}"]
    rival = ruled("", *table4.SAMPLES)
    needed = (ours[f"{sample} needed components"] for sample in table4.SAMPLES)
    rival.add_row(Text(f"{table4.OURS} / {table4.RIVAL}"), *map(figure, needed))
    savings = ruled("li-torrance without", "time saved", "its share\nof the passes")
    for case, found in dropped.items():
        saved, share = found["time saved"].value, found["share of the passes"].value
        savings.add_row(Text(case.removeprefix(table4.WITHOUT)), f"{saved:.1%}", f"{share:.1%}")
    about = (
        f"Table 4 of Li & Torrance (2005): run time as a multiple of {table4.UNIT}'s, in the paper (its range over the "
        "samples) and here (green channel of each sample, float32, tiled), and the error of each model's fit: of the "
        "published fit, for the measurements are not public, in the same order."
    )
    return ["", Text(about), "", costs, "", rival, "", savings]


def stress_table(records: list[Record]) -> Group:
    """Non-finite results of every model in both precisions, the error of float32, and where the failures were."""
    cases = by_case(records)
    table = ruled("non-finite", *(kind.replace(" derivatives", "") for kind in stress.KINDS), "float32\nerror")
    for case, found in cases.items():
        table.add_row(case_name(case))
        for dtype in ("float32", "float64"):
            counts = [found[f"{dtype} non-finite {kind}"] for kind in stress.KINDS]
            error = [found["float32 error"]] if dtype == "float32" else []
            table.add_row(f"  {dtype}", *map(figure, [*counts, *error]))
    points = max(found["points"].value or 0 for found in cases.values())
    shares = ", ".join(
        f"{kind.removesuffix(' derivatives')} at 1 in {share}" for kind, (_, share) in stress.KINDS.items() if share > 1
    )
    about = (
        f"{points:,} adversarial points a model, a tenth for sums over facets ({shares}): how many gave anything not "
        f"finite. Error of float32 against float64 as a multiple of the one allowed: {precision.RELATIVE:g} relative "
        f"or {precision.OF_PEAK:g} of the peak."
    )
    return Group(Text(about), "", table, *notes(records))


def by_case(records: list[Record]) -> dict[str, dict[str, Record]]:
    cases: dict[str, dict[str, Record]] = {}
    for record in records:
        cases.setdefault(record.case, {})[record.metric] = record
    return cases


def ruled(first: str, *columns: str) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column(first, no_wrap=True)
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    return table


def case_name(case: str) -> Text:
    """The expression of a model, its options on a line of their own."""
    return Text(case.replace("(", "\n  (", 1), style="bold")


def figure(record: Record | None) -> Text:
    if record is None or record.value is None:
        return Text("")
    whole = isinstance(record.value, int) or 100 <= record.value < 1e6
    return Text(f"{record.value:,.0f}" if whole else f"{record.value:.3g}", style="red" if record.misses else "")


def notes(records: list[Record]) -> list[Text]:
    """What missed its limit, and where; and what could not be measured."""
    lines = [Text("")]
    for record in records:
        if record.misses or record.value is None:
            target = f" = {record.value:.4g}, limit {record.limit:g}" if record.misses else ""
            lines.append(Text(f"{record.case}: {record.metric}{target}", style="red"))
            lines += [Text(f"  {line}") for line in record.note.splitlines()]
    return lines
