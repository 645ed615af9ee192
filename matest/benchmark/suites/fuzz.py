"""Damaged files: what every reader makes of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Group

from matest.benchmark.instruments.endurance import Account, Reader, accounts, available
from matest.benchmark.instruments.readers import READERS
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.tables import by_case, listed, page

# Inputs of a reader that takes as long as one of small images.
INPUTS = 100_000
INPUTS_QUICK = 100
METRICS = ("inputs", "read", "refused", "faults")


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every reader."""
    if not available():
        note = "processes are limited and measured as this needs it on Linux alone"
        yield Record("fuzz", "every reader", "faults", None, "1", limit=0, note=note)
        return
    inputs = INPUTS_QUICK if effort.quick else INPUTS
    for number, (reader, account) in enumerate(accounts(READERS, inputs, effort.seconds)):
        progress(reader.name, number + 1, len(READERS))
        yield from figures(reader, account)


def figures(reader: Reader, account: Account) -> Iterator[Record]:
    """Records of one reader."""
    for metric in METRICS[:-1]:
        yield Record("fuzz", reader.name, metric, getattr(account, metric), "1", "higher")
    note = "\n".join(f"input {fault.number}: {fault.words}" for fault in account.told)
    yield Record("fuzz", reader.name, "faults", account.faults, "1", limit=0, note=note)


def table(records: Sequence[Record]) -> Group:
    """How many files of each reader were tried, read and refused in a sentence, and how many ended otherwise."""
    about = (
        "Valid files after bits, bytes, numbers, words, lines or values of them were changed, and parts of two files "
        "put together. Refused: by one sentence that names the file. A fault is any other exception, a crash, anything "
        "printed, a number that is not finite, 10 s of work, or four times the memory that files may ask for."
    )
    return page(about, listed("reader", METRICS, by_case(records)), records=records)


SUITE = Suite(measure, table, share=30)
