"""The summary of many captures: a row each, as CSV, as JSON and as tables for a terminal."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from rich.console import Group
from rich.table import Column
from rich.text import Text

from matest.errors import BAD_INPUT, WORK_FAILED, InputError, printable
from matest.outputs import check_writable, json_text
from matest.places import whole_file
from matest.report.format import chi2, share
from matest.report.tables import plain_table

SCHEMA = "matest.summary/1"
# The files; the one that marks them as ours comes last.
FILES = ("summary.csv", "summary.json")
# Captures that a terminal shows one by one; of more, only the worst and those without a result.
_ALL = 20
_WORST = 10
# Columns of the CSV before those of the parameters.
_COLUMNS = ("name", "model", "status", "chi2", "relative_rmse", "warnings", "seconds", "error")
# What rows tell of the run rather than of the capture.
_PRESENT_RUN = ("kept", "lacks_memory")


@dataclass(frozen=True)
class Row:
    """What one capture came to.

    Attributes:
        name: of the capture.
        status: of the fit, or why there is no result: "bad input" (the capture's fault) or "failed".
        model: its expression.
        chi2: reduced χ² of the fit.
        relative_rmse: of the fit.
        parameters: value and standard error by the label of the result's correlation (`albedo[0]` is that of the first
            channel); None where it is not determined.
        warnings: their number.
        seconds: that the estimate took.
        error: the sentence on why there is no result.
        kept: whether the result was there before.
        lacks_memory: whether there is none because memory did not suffice.
    """

    name: str
    status: Literal["converged", "not converged", "bad input", "failed"]
    model: str = ""
    chi2: float | None = None
    relative_rmse: float | None = None
    parameters: Mapping[str, tuple[float | None, float | None]] = field(default_factory=dict)
    warnings: int = 0
    seconds: float = 0.0
    error: str = ""
    kept: bool = False
    lacks_memory: bool = False

    @classmethod
    def of(cls, name: str, result: Mapping[str, Any], kept: bool = False) -> Row:
        """The row of a result.

        Args:
            name: of the capture.
            result: content of its result.json.
            kept: whether it was there before.
        """
        fit = result["fit"]
        return cls(
            name, fit["status"], result["model"], fit["reduced_chi2"], fit["relative_rmse"],
            _parameters(result["parameters"]), len(result["warnings"]), result["timing_s"]["total"], kept=kept,
        )  # fmt: skip

    @property
    def exit_code(self) -> int:
        """Exit code of a command with this capture alone."""
        return {"bad input": BAD_INPUT, "failed": WORK_FAILED}.get(self.status, 0)


def _parameters(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[float | None, float | None]]:
    """Value and standard error of every number of a result."""
    numbers: dict[str, tuple[float | None, float | None]] = {}
    for name, parameter in parameters.items():
        value, std = parameter["value"], parameter["std"]
        if isinstance(value, list):
            stds = std if isinstance(std, list) else [std] * len(value)
            numbers |= {f"{name}[{k}]": both for k, both in enumerate(zip(value, stds, strict=True))}
        else:
            numbers[name] = value, std
    return numbers


def in_order(rows: Iterable[Row]) -> list[Row]:
    """Rows in the order in which one looks at them: those without a result, then from the largest χ² to the least."""
    return sorted(rows, key=lambda row: (row.chi2 is not None, -(row.chi2 or 0.0), row.name))


def check_summary(folder: Path) -> None:
    """Refuse to replace files of somebody else by a summary.

    Raises:
        InputError: there are such files.
        OSError: nothing can be written to the folder.
    """
    check_writable(folder)
    present = [folder / name for name in FILES if (folder / name).exists()]
    try:
        ours = not present or json.loads((folder / FILES[-1]).read_text("utf-8"))["schema"] == SCHEMA
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        ours = False
    if not ours:
        raise InputError(f"{present[0]}: would be replaced, but is none of matest's; give another folder with -o.")


def write_summary(folder: Path, rows: Sequence[Row]) -> None:
    """Write `summary.csv` and `summary.json`.

    Raises:
        OSError: they cannot be written.
    """
    plain = [{name: value for name, value in asdict(row).items() if name not in _PRESENT_RUN} for row in rows]
    text = json_text({"schema": SCHEMA, "captures": plain}, indent=1, ensure_ascii=False) + "\n"
    # Marked as UTF-8, so that spreadsheets read names as they are.
    for name, content, encoding in zip(FILES, (_csv(rows), text), ("utf-8-sig", "utf-8"), strict=True):
        whole_file(folder / name, content.encode(encoding, "backslashreplace"))


def _csv(rows: Sequence[Row]) -> str:
    labels = list(dict.fromkeys(label for row in rows for label in row.parameters))
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*_COLUMNS, *(column for label in labels for column in (label, f"{label} std"))])
    for row in rows:
        numbers = [number for label in labels for number in row.parameters.get(label, (None, None))]
        table.writerow([*(getattr(row, name) for name in _COLUMNS), *numbers])
    return text.getvalue()


def summary_table(rows: Sequence[Row]) -> Group:
    """Rows as 80 columns show them: the captures that have a result, of many only the worst, and totals."""
    good = [row for row in rows if not row.error]
    shown = good if len(good) <= _ALL else good[:_WORST]
    title = "" if shown == good else f"the {_WORST} with the largest χ²"
    numbers = (Column(name, justify="right", no_wrap=True) for name in ("χ²", "relative\nrms error", "warnings"))
    table = plain_table(Column("capture", overflow="fold"), Column("model", overflow="fold"), *numbers, "fit")
    table.title = Text(title)
    for row in shown:
        numbers_of_row = chi2(row.chi2 or 0.0), share(row.relative_rmse), str(row.warnings)
        table.add_row(printable(row.name), row.model, *numbers_of_row, row.status)
    return Group(*([table] if shown else []), Text(totals(rows)))


def failures(rows: Sequence[Row]) -> list[str]:
    """Why captures have no result, a sentence each; of many the first, and how many more there are."""
    sentences = [row.error for row in rows if row.error]
    more = len(sentences) - _ALL
    return [*sentences[:_ALL], *([f"and {more:,} more captures have no result; see the summary."] if more > 0 else [])]


def totals(rows: Sequence[Row]) -> str:
    """How many captures came to what, in a sentence."""
    counts = {
        "converged": sum(row.status == "converged" for row in rows),
        "not converged": sum(row.status == "not converged" for row in rows),
        "bad input": sum(row.status == "bad input" for row in rows),
        "failed": sum(row.status == "failed" for row in rows),
        "complete before": sum(row.kept for row in rows),
    }
    captures = "1 capture" if len(rows) == 1 else f"{len(rows):,} captures"
    return f"{captures}: " + ", ".join(f"{count:,} {what}" for what, count in counts.items() if count) + "."
