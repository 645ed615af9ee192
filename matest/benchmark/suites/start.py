"""How long a fresh process takes: importing matest, its help, and an estimate of a small capture."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from rich.console import Group
from rich.text import Text

from matest.benchmark.instruments.photographs import take
from matest.benchmark.record import Progress, Record
from matest.benchmark.tables import by_case, figure, notes, ruled

MODEL, IMAGES, SIZE = "oren-nayar", 3, 128
ROUNDS, ROUNDS_QUICK = 5, 1
# Seconds of the help, and the estimate as a multiple of what it cannot do without.
HELP_LIMIT, RATIO_LIMIT = 0.3, 1.5
CASE = f"{IMAGES} images of {SIZE}×{SIZE} pixels"


def run(quick: bool, progress: Progress) -> Iterator[Record]:
    """Records of every process, the shortest time of each; they take turns."""
    rounds = ROUNDS_QUICK if quick else ROUNDS
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


def start_table(found: list[Record]) -> Group:
    """Time of every process, and the ratio."""
    table = ruled("", "seconds", "limit")
    for case, metrics in by_case(found).items():
        for name, record in metrics.items():
            limit = "" if record.limit is None else f"{record.limit:g}"
            unit = "times" if record.unit == "1" else ""
            table.add_row(name, figure(record).append(f" {unit}" if unit else ""), limit)
        about = (
            f"Fresh processes, their start included; the estimate is of {case} with {MODEL}. fit: its own count, "
            "without reading, geometry and report."
        )
    return Group(Text(about), "", table, *notes(found))
