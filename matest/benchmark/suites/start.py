"""How long a fresh process takes: importing matest, its help, and an estimate of a small capture."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Group

from matest.benchmark.instruments.photographs import take
from matest.benchmark.record import Progress, Record
from matest.benchmark.suite import Effort, Suite
from matest.benchmark.tables import figure, limit, page, ruled

MODEL, IMAGES, SIZE = "oren-nayar", 3, 128
ROUNDS, ROUNDS_QUICK = 5, 1
# Seconds of the help.
HELP_LIMIT = 0.3
# The estimate as a multiple of what it cannot do without.
RATIO_LIMIT = 1.5
CASE = f"{IMAGES} images of {SIZE}×{SIZE} pixels"


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every process, the shortest time of each; they take turns."""
    rounds = ROUNDS_QUICK if effort.quick else ROUNDS
    with tempfile.TemporaryDirectory() as name:
        progress("taking the photographs")
        folder = take(Path(name), MODEL, images=IMAGES, size=SIZE)
        out = Path(name, "result")
        commands = {
            "python": ["-c", "pass"],
            "import matest": ["-c", "import matest"],
            "matest --help": ["-m", "matest", "--help"],
            "import torch": ["-c", "import torch"],
            "matest estimate": ["-m", "matest", "estimate", str(folder), "--model", MODEL, "-o", str(out)],
        }
        times: dict[str, list[float]] = {name: [] for name in commands}
        fits = []
        for number in range(rounds):
            progress("fresh processes", number, rounds)
            for command, arguments in commands.items():
                times[command].append(seconds(*arguments))
            fits.append(json.loads((out / "result.json").read_text("utf-8"))["timing_s"]["fit"])
    shortest = {command: min(taken) for command, taken in times.items()}
    for command, taken in shortest.items():
        yield Record("start", CASE, command, taken, "s", limit=HELP_LIMIT if command == "matest --help" else None)
    yield Record("start", CASE, "fit", min(fits), "s")
    needed = shortest["import torch"] + min(fits)
    note = f"{shortest['matest estimate']:.2f} s against {needed:.2f} s"
    ratio = shortest["matest estimate"] / needed
    yield Record("start", CASE, "estimate / (import torch + fit)", ratio, "1", limit=RATIO_LIMIT, note=note)


def seconds(*arguments: str) -> float:
    """Wall-clock time of a Python process with these arguments."""
    start = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
    return time.perf_counter() - start


def table(found: Sequence[Record]) -> Group:
    """Time of every process, and the ratio."""
    processes = ruled("", "seconds", "limit")
    for record in found:
        unit = " times" if record.unit == "1" else ""
        processes.add_row(record.metric, figure(record).append(unit), limit(record))
    about = (
        f"Fresh processes, their start included; the estimate is of {CASE} with {MODEL}. fit: its own count, without "
        "reading, geometry and report."
    )
    return page(about, processes, records=found)


SUITE = Suite(measure, table)
