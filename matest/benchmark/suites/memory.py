"""Peak memory of an estimate, of few photographs and of ten times as many."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

import tomli_w
from rich.console import Group

from matest.benchmark.instruments.photographs import FIX, in_files
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.tables import by_case, listed, page

# Photographs of the first estimate, and how many times as many the second has.
FEW = 12
TIMES = 10
# Pixels on a side of the images.
SIZE = 1024
SIZE_QUICK = 192
# Megabytes by which the peak may grow.
LIMIT = 200.0
MODELS = ("oren-nayar", "cook-torrance")

# The high-water mark of the process's own memory; `getrusage` would count that of the process that started it.
_CHILD = """
import json, sys, matest
matest.estimate(matest.load_capture(sys.argv[1]), sys.argv[2], fix=json.loads(sys.argv[3]))
with open("/proc/self/status") as status:
    print(next(line.split()[1] for line in status if line.startswith("VmHWM")))
"""


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of the estimates of every model, each in a process of its own; of the first model in a quick run."""
    for expression in MODELS[: 1 if effort.quick else None]:
        yield from peaks(expression, SIZE_QUICK if effort.quick else SIZE, progress)


def peaks(expression: str, size: int, progress: Progress) -> Iterator[Record]:
    """Peak of `FEW` photographs and of `TIMES` as many, the same ones named again."""
    if not Path("/proc/self/status").exists():
        note = "the peak memory of a process is only known on Linux"
        yield Record("memory", expression, "growth", None, "MB", limit=LIMIT, note=note)
        return
    progress(f"{expression}: taking the photographs")
    with in_files(expression, images=FEW, size=size) as folder:
        progress(f"{expression}: {FEW} photographs")
        few = peak(folder, expression)
        file = folder / "capture.toml"
        tables = tomllib.loads(file.read_text("utf-8"))
        file.write_text(tomli_w.dumps({**tables, "image": tables["image"] * TIMES}), "utf-8")
        progress(f"{expression}: {FEW * TIMES} photographs")
        many = peak(folder, expression)
    yield Record("memory", expression, f"peak of {FEW}", few, "MB")
    yield Record("memory", expression, f"peak of {FEW * TIMES}", many, "MB")
    yield Record("memory", expression, "peak ratio", many / few, "1")
    note = f"{FEW} and {FEW * TIMES} photographs of {size}×{size} pixels"
    yield Record("memory", expression, "growth", many - few, "MB", limit=LIMIT, note=note)


def peak(folder: Path, expression: str) -> float:
    """Peak resident memory in megabytes (10⁶ bytes) of a process that reads and estimates a capture."""
    command = [sys.executable, "-c", _CHILD, str(folder), expression, json.dumps(FIX[expression])]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout) * 1024 / 1e6


def table(records: Sequence[Record]) -> Group:
    """Both peaks and their difference."""
    megabytes = listed("megabytes", (f"peak of {FEW}", f"peak of {FEW * TIMES}", "growth"), by_case(records))
    about = f"Peak memory of reading and estimating {FEW} and {FEW * TIMES} photographs; limit of growth {LIMIT:g} MB."
    return page(about, megabytes, records=records)


SUITE = Suite(measure, table)
