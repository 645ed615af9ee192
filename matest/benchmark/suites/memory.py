"""Peak memory of an estimate, of few photographs and of ten times as many."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

import tomli_w
from rich.console import Group

from matest.benchmark.instruments.photographs import FIX, take
from matest.benchmark.record import Progress, Record
from matest.benchmark.suite import Effort, Suite
from matest.benchmark.tables import by_case, listed, page

FEW, TIMES = 12, 10
SIZE, SIZE_QUICK = 1024, 192
# Megabytes by which the peak may grow.
LIMIT = 200.0
MODELS, MODELS_QUICK = ("oren-nayar", "cook-torrance"), ("oren-nayar",)

# The high-water mark of the process's own memory; `getrusage` would count that of the process that started it.
_CHILD = """
import json, sys, matest
matest.estimate(matest.load_capture(sys.argv[1]), sys.argv[2], fix=json.loads(sys.argv[3]))
with open("/proc/self/status") as status:
    print(next(line.split()[1] for line in status if line.startswith("VmHWM")))
"""


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of the estimates of every model, each in a process of its own."""
    for expression in MODELS_QUICK if effort.quick else MODELS:
        yield from peaks(expression, SIZE_QUICK if effort.quick else SIZE, progress)


def peaks(expression: str, size: int, progress: Progress) -> Iterator[Record]:
    """Peak of `FEW` photographs and of `TIMES` as many, the same ones named again."""
    if not Path("/proc/self/status").exists():
        note = "the peak memory of a process is only known on Linux"
        yield Record("memory", expression, "growth", None, "MB", limit=LIMIT, note=note)
        return
    with tempfile.TemporaryDirectory() as name:
        progress(f"{expression}: taking the photographs")
        folder = take(Path(name), expression, images=FEW, size=size)
        progress(f"{expression}: {FEW} photographs")
        few = peak(folder, expression)
        repeat(folder / "capture.toml", TIMES)
        progress(f"{expression}: {FEW * TIMES} photographs")
        many = peak(folder, expression)
    yield Record("memory", expression, f"peak of {FEW}", few, "MB")
    yield Record("memory", expression, f"peak of {FEW * TIMES}", many, "MB")
    yield Record("memory", expression, "peak ratio", many / few, "1")
    note = f"{FEW} and {FEW * TIMES} photographs of {size}×{size} pixels"
    yield Record("memory", expression, "growth", many - few, "MB", limit=LIMIT, note=note)


def repeat(file: Path, times: int) -> None:
    """Let a capture name every photograph `times` times."""
    tables = tomllib.loads(file.read_text("utf-8"))
    tables["image"] = tables["image"] * times
    file.write_text(tomli_w.dumps(tables), "utf-8")


def peak(folder: Path, expression: str) -> float:
    """Peak resident memory in megabytes (10⁶ bytes) of a process that reads and estimates a capture."""
    command = [sys.executable, "-c", _CHILD, str(folder), expression, json.dumps(FIX[expression])]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return int(done.stdout) * 1024 / 1e6


def table(found: Sequence[Record]) -> Group:
    """Both peaks and their difference."""
    megabytes = listed("megabytes", (f"peak of {FEW}", f"peak of {FEW * TIMES}", "growth"), by_case(found))
    about = f"Peak memory of reading and estimating {FEW} and {FEW * TIMES} photographs; limit of growth {LIMIT:g} MB."
    return page(about, megabytes, records=found)


SUITE = Suite(measure, table)
