"""Damaged files: a small run over every reader, and that the instrument notices whatever can go wrong."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from matest.benchmark.instruments import damage
from matest.benchmark.instruments.endurance import Endurance, Reader, accounts, available
from matest.benchmark.instruments.readers import READERS
from matest.errors import InputError

# What is imported here each process imports that is replaced: torch is not.

pytestmark = pytest.mark.skipif(not available(), reason="limits and measures a process as Linux does")

# Damaged files of a cheap reader, of which each is another one.
INPUTS = 30
GOOD = b"as it should be"


def good() -> list[dict[str, bytes]]:
    return [{"a.bin": GOOD}]


def unlike(misbehave: Callable[[Path], Any], folder: Path) -> Iterable[Any]:
    """Reads the good file, refuses half of the others as it should, and does something else with the rest."""
    content = (folder / "a.bin").read_bytes()
    if content == GOOD:
        return [1.0]
    if len(content) == len(GOOD):
        raise InputError(f"{folder / 'a.bin'}: is damaged; copy it again.")
    return misbehave(folder)


def abort(_: Path) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def hang(_: Path) -> None:
    while True:
        pass


def fail(_: Path) -> None:
    raise KeyError("width")


def fill(_: Path) -> list[float]:
    return [float(len(bytearray(300 << 20)))]


def talk(_: Path) -> list[float]:
    print("unknown field")
    return []


def divide(_: Path) -> list[float]:
    return [float("nan")]


def mumble(_: Path) -> None:
    raise InputError("something is wrong.")


def read(_: Path) -> list[float]:
    return [2.0]


MISDEEDS = {
    abort: "the process ended by SIGSEGV",
    hang: "no end in 1 s",
    fail: "KeyError: 'width' (",
    fill: "more than 256 MB of memory",
    talk: "prints: unknown field",
    divide: "numbers that are not finite",
    mumble: "a refusal that names no file",
}


def of(misbehave: Callable[[Path], Any]) -> Reader:
    damages = (damage.flipped, damage.truncated)
    return Reader("test", "a.bin", good, partial(unlike, misbehave), damages, seconds=1.0)


def test_no_reader_has_a_fault() -> None:
    cheap = [reader for reader in READERS if INPUTS // reader.cost]
    tried = list(accounts(cheap, INPUTS))
    assert [(reader.name, fault) for reader, account in tried for fault in account.told] == []
    assert all(account.inputs == INPUTS // reader.cost for reader, account in tried)
    # Damage is neither always noticed nor never.
    assert all(sum(getattr(account, kind) for _, account in tried) > 50 for kind in ("read", "refused"))


@pytest.fixture(scope="module")
def endurance() -> Iterator[Endurance]:
    with Endurance() as process:
        yield process


@pytest.mark.parametrize("misbehave", MISDEEDS, ids=lambda one: one.__name__)
def test_what_goes_wrong_is_noticed(endurance: Endurance, misbehave: Callable[[Path], Any]) -> None:
    account = endurance.account(of(misbehave), 3)
    assert account.inputs == 3
    assert account.faults > 0
    assert account.told[0].words.startswith(MISDEEDS[misbehave])


def test_inputs_are_the_same_every_time() -> None:
    reader = of(read)
    inputs = [reader.damaged(number) for number in range(50)]
    assert inputs == [reader.damaged(number) for number in range(50)]
    assert len({*inputs}) > 40


def test_every_suffix_that_is_read_is_damaged() -> None:
    from matest.photographs.readers import READERS as IMAGE_READERS
    from matest.tables import FORMATS

    suffixes = {Path(reader.file).suffix for reader in READERS}
    # Other suffixes of the same formats, and of cameras, all of which LibRaw reads.
    alike = {".tiff", ".jpeg", ".pgm", ".j2k", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".raf", ".rw2", ".pef", ".srw"}
    assert {*IMAGE_READERS, *FORMATS} - alike <= suffixes


def test_the_table_names_what_went_wrong(endurance: Endurance) -> None:
    from rich.console import Console

    from matest.benchmark import load
    from matest.benchmark.suites import fuzz

    records = list(fuzz.figures(of(fail), endurance.account(of(fail), 3)))
    values = {record.metric: record.value for record in records}
    assert values["inputs"] == 3 == values["read"] + values["refused"] + values["faults"]
    terminal = Console(width=80, record=True)
    terminal.print(load("fuzz").table(records))
    assert "KeyError: 'width'" in terminal.export_text()


@pytest.mark.parametrize(
    "kind", [*damage.OF_BYTES, *damage.OF_TEXT, damage.revalued_json], ids=lambda one: one.__name__
)
@pytest.mark.parametrize("content", [b"", b"0", b'{"a": [1, 2, {"b": null}]}'])
def test_any_content_can_be_damaged(kind: damage.Damage, content: bytes) -> None:
    for seed in range(30):
        assert isinstance(kind(content, np.random.default_rng(seed)), bytes)
