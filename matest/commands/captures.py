"""Many captures in one command: progress, summary, and what is complete when it ends early."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import typer

from matest import batch, interruption
from matest.batch import Job
from matest.commands.console import console, print_json, progress_over
from matest.errors import WorkError, printable
from matest.estimation.result import read_result
from matest.places import reserved, sweep
from matest.report.summary import Row, check_summary, failures, in_order, summary_table, write_summary


def estimate_all(
    jobs: Sequence[Job], out: Path | None, workers: int, memory: int | None, scheduler: str | None, as_json: bool
) -> list[Row]:
    """Do jobs and print what they came to; returns their rows, the worst first.

    Args:
        jobs: at least one.
        out: folder for the summary; None: it is only printed.
        workers, memory, scheduler: see `batch.run_all`.
        as_json: print every result instead of the summary.

    Raises:
        InputError: see `batch.run_all`, or the summary would replace a file of somebody else.
        WorkError: another run writes to `out`, or this one was interrupted.
    """
    with _folder(out):
        rows = _done(jobs, workers, memory, scheduler)
        in_their_order = in_order(rows.values())
        if out is not None:
            write_summary(out, in_their_order)
    for sentence in failures(in_their_order):
        typer.echo(f"matest: {printable(sentence)}", err=True)
    if as_json:
        contents = {job.label: _content(job, rows[job.out]) for job in jobs}
        print_json(contents if len(jobs) > 1 else next(iter(contents.values())))
    else:
        console().print(summary_table(in_their_order))
        if out is not None:
            console().print(f"Results in {out} (open {out / 'summary.csv'})", soft_wrap=True)
    return in_their_order


def _done(jobs: Sequence[Job], workers: int, memory: int | None, scheduler: str | None) -> dict[Path, Row]:
    """The rows of all jobs by their result folder.

    Raises:
        WorkError: it says how many are complete.
    """
    rows: dict[Path, Row] = {}

    def sentence(why: str = "interrupted;") -> str:
        complete = sum(not row.error for row in rows.values())
        return f"{why} {complete:,} of {len(jobs):,} captures are complete; go on with --resume."

    def remove_remains() -> None:
        for job in jobs:
            sweep(job.out)

    try:
        with (
            interruption.sentence(sentence, remove_remains),
            progress_over(len(jobs)) as advance,
            contextlib.closing(batch.run_all(jobs, workers, memory, scheduler)) as done,
        ):
            for job, row in done:
                rows[job.out] = row
                advance()
    except (KeyboardInterrupt, WorkError) as error:
        raise WorkError(sentence(str(error) or "interrupted;")) from None
    return rows


@contextlib.contextmanager
def _folder(out: Path | None) -> Iterator[None]:
    """The folder of all results, for this run alone; it does not stay if nothing comes to lie in it."""
    if out is None:
        yield
        return
    check_summary(out)
    with reserved(out):
        out.mkdir(exist_ok=True)
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                out.rmdir()


def _content(job: Job, row: Row) -> dict:
    """The result of a job as JSON, or why there is none."""
    return {"error": row.error} if row.error else read_result(job.out)
