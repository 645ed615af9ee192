"""What a user waits for: the whole command on captures that do not state their noise, against decoding them."""

from __future__ import annotations

import json
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w
from rich.console import Group

from matest.benchmark.instruments.photographs import in_files
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.suites.limits import decode
from matest.benchmark.tables import by_case, listed, page

MODEL = "oren-nayar"
STAGES = ("read", "geometry", "fit", "report")
# Whole command without imports against decoding, at most.
RATIO_LIMIT = 4.0

# Runs the command, then says what it took: processor seconds, high-water mark of memory, modules loaded.
_COMMAND = """
import json, sys, time
from matest.cli import main
try:
    main()
except SystemExit as end:
    if end.code:
        raise
with open("/proc/self/status") as status:
    peak = next(line.split()[1] for line in status if line.startswith("VmHWM"))
modules = [name for name, module in sys.modules.items() if getattr(module, "__file__", None)]
print(json.dumps({"cpu": time.process_time(), "peak": int(peak) * 1024 / 1e6, "modules": modules}))
"""
# Imports the same modules and nothing else. Some extensions make modules as they load, which no one else can import.
_IMPORTS = """
import contextlib, importlib, json, sys, time
for name in json.loads(sys.stdin.read()):
    if name != "__main__":
        with contextlib.suppress(ModuleNotFoundError):
            importlib.import_module(name)
print(json.dumps({"cpu": time.process_time()}))
"""


@dataclass(frozen=True)
class Case:
    """A capture as people have them.

    Attributes:
        images: number of photographs.
        size: pixels on a side.
        mesh: whether the object is a mesh that shadows itself, or a sphere.
        peak_limit: megabytes of memory, at most; None: no limit.
        tells_ratio: whether it takes much longer than imports do more or less.
    """

    images: int
    size: int
    mesh: bool = False
    peak_limit: float | None = None
    tells_ratio: bool = True

    @property
    def name(self) -> str:
        """For the table."""
        return f"{self.images} × {self.size}², {'mesh' if self.mesh else 'sphere'}"


QUICK_CASES = (Case(6, 64, tells_ratio=False), Case(12, 1024))
CASES = (
    *QUICK_CASES,
    Case(12, 1024, mesh=True),
    Case(6, 3464, mesh=True, peak_limit=1500),
    Case(3, 4899, mesh=True, peak_limit=2000),
)


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every capture; of the small ones in a quick run."""
    if not Path("/proc/self/status").exists():
        note = "the peak memory of a process is only known on Linux"
        yield Record("command", CASES[0].name, "command / decode", None, "1", limit=RATIO_LIMIT, note=note)
        return
    cases = QUICK_CASES if effort.quick else CASES
    for number, case in enumerate(cases):
        progress("whole commands", number, len(cases))
        with in_files(MODEL, images=case.images, size=case.size, mesh=case.mesh) as folder:
            forget_noise(folder / "capture.toml")
            yield from figures(case, folder)


def forget_noise(file: Path) -> None:
    """Let a capture file state no noise."""
    tables = tomllib.loads(file.read_text("utf-8"))
    del tables["noise"]
    file.write_text(tomli_w.dumps(tables), "utf-8")


def figures(case: Case, folder: Path) -> Iterator[Record]:
    """Records of one capture."""
    cost = cost_of(folder, "--model", MODEL)
    seconds = {"decode": cost.decode, "imports": cost.imports, "command": cost.command, **cost.stages}
    for metric, value in seconds.items():
        yield Record("command", case.name, metric, value, "s")
    yield Record("command", case.name, "peak", cost.peak, "MB", limit=case.peak_limit)
    if case.tells_ratio:
        yield Record("command", case.name, "command / decode", cost.ratio, "1", limit=RATIO_LIMIT, note=cost.account)


class Cost(NamedTuple):
    """What the whole command takes, in processor seconds.

    Attributes:
        decode: decoding the photographs, by OpenCV alone.
        imports: of the modules that the command loads.
        command: from the start of the process to the written result, without the imports.
        peak: of memory, megabytes.
        stages: by the clock, as the command itself counts them.
    """

    decode: float
    imports: float
    command: float
    peak: float
    stages: dict[str, float]

    @property
    def ratio(self) -> float:
        """The command as a multiple of decoding."""
        return self.command / self.decode

    @property
    def account(self) -> str:
        """For a person."""
        return f"{self.command:.1f} s against {self.decode:.2f} s of decoding"


def cost_of(folder: Path, *options: str) -> Cost:
    """What `matest estimate` with these options takes on a capture."""
    start = time.process_time()
    decode(folder)
    decoding = time.process_time() - start
    out = folder / "result"
    taken = _last_line(_COMMAND, ["estimate", str(folder), *options, "-o", str(out)])
    imports = _last_line(_IMPORTS, [], json.dumps(taken["modules"]))["cpu"]
    timing = json.loads((out / "result.json").read_text("utf-8"))["timing_s"]
    return Cost(decoding, imports, taken["cpu"] - imports, taken["peak"], {stage: timing[stage] for stage in STAGES})


def _last_line(program: str, arguments: Sequence[str], text: str = "") -> dict[str, Any]:
    """What a Python process with this program says in its last line."""
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], input=text, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def table(records: Sequence[Record]) -> Group:
    """Seconds and memory of every capture, and the ratios."""
    rows = by_case(records)
    about = (
        f"Fresh processes of 'matest estimate --model {MODEL}', noise not stated. Decode: OpenCV alone; command: from "
        "the start of the process to the written result, without the imports: all three in processor seconds. Stages "
        "by the clock, on all processors; peak in megabytes."
    )
    whole = listed("whole", ("decode", "imports", "command", "peak", "command / decode"), rows)
    return page(about, whole, listed("stages", STAGES, rows), records=records)


SUITE = Suite(measure, table)
