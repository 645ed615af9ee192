"""How long a fresh process takes: importing matest, its help, and an estimate of a small capture."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence

from rich.console import Group

from matest.benchmark.instruments.passes import timed
from matest.benchmark.instruments.photographs import in_files
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.tables import figure, limit, page, ruled

MODEL = "oren-nayar"
IMAGES = 3
# Pixels on a side of the images: small, so that the start of a process shows.
SIZE = 128
# Processes of each kind, of which the shortest time counts.
ROUNDS = 5
ROUNDS_QUICK = 1
# Most seconds of the help.
HELP_LIMIT = 0.3
# The estimate as a multiple of what it cannot do without, at most.
RATIO_LIMIT = 1.5
CASE = f"{IMAGES} images of {SIZE}×{SIZE} pixels"


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every process, the shortest time of each; they take turns."""
    progress("taking the photographs")
    turns = []
    with in_files(MODEL, images=IMAGES, size=SIZE) as folder:
        out = folder / "result"
        commands = {
            "python": ["-c", "pass"],
            "import matest": ["-c", "import matest"],
            "matest --help": ["-m", "matest", "--help"],
            "import torch": ["-c", "import torch"],
            "matest estimate": ["-m", "matest", "estimate", str(folder), "--model", MODEL, "-o", str(out)],
        }
        rounds = ROUNDS_QUICK if effort.quick else ROUNDS
        for number in range(rounds):
            progress("fresh processes", number, rounds)
            turn = {command: seconds(*arguments) for command, arguments in commands.items()}
            turns.append({**turn, "fit": json.loads((out / "result.json").read_text("utf-8"))["timing_s"]["fit"]})
    shortest = {name: min(turn[name] for turn in turns) for name in (*commands, "fit")}
    for name, taken in shortest.items():
        yield Record("start", CASE, name, taken, "s", limit=HELP_LIMIT if name == "matest --help" else None)
    needed = shortest["import torch"] + shortest["fit"]
    note = f"{shortest['matest estimate']:.2f} s against {needed:.2f} s"
    ratio = shortest["matest estimate"] / needed
    yield Record("start", CASE, "estimate / (import torch + fit)", ratio, "1", limit=RATIO_LIMIT, note=note)


def seconds(*arguments: str) -> float:
    """Wall-clock time of a Python process with these arguments."""
    return timed(lambda: subprocess.run([sys.executable, *arguments], check=True, capture_output=True))[1]


def table(records: Sequence[Record]) -> Group:
    """Time of every process, and the ratio."""
    processes = ruled("", "seconds", "limit")
    for record in records:
        unit = " times" if record.unit == "1" else ""
        processes.add_row(record.metric, figure(record).append(unit), limit(record))
    about = (
        f"Fresh processes, their start included; the estimate is of {CASE} with {MODEL}. fit: its own count, without "
        "reading, geometry and report."
    )
    return page(about, processes, records=records)


SUITE = Suite(measure, table)
