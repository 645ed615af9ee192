"""Output of the commands: a progress bar, tables, JSON, notes; all but JSON can be hushed."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, cast

import typer

from matest.errors import printable
from matest.outputs import json_text
from matest.progress import Progress, silent

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook
    from rich.segment import Segment

# Whether nothing is printed but errors and what --json asks for.
_hushed: ContextVar[bool] = ContextVar("hushed", default=False)


@contextmanager
def hushed(quiet: bool) -> Iterator[None]:
    """Within, where `quiet`: no progress, tables and notes."""
    before = _hushed.set(quiet)
    try:
        yield
    finally:
        _hushed.reset(before)


@contextmanager
def progress(title: str) -> Iterator[Progress]:
    """A progress bar that names the present step; nothing in a pipe."""
    if _hushed.get() or not sys.stderr.isatty():
        yield silent
        return
    from rich import progress as bars
    from rich.console import Console

    title = printable(title)
    columns = (
        bars.SpinnerColumn(), bars.BarColumn(bar_width=20), bars.TextColumn("{task.description}", markup=False),
        bars.TimeElapsedColumn(),
    )  # fmt: skip
    with bars.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)

        def say(what: str, done: int | None = None, total: int | None = None) -> None:
            bar.update(task, description=f"{title}: {printable(what)}", completed=done or 0, total=total)

        yield say


@contextmanager
def progress_over(total: int) -> Iterator[Callable[[], None]]:
    """A progress bar over captures, to be called for each that is done: rate, remaining time; nothing in a pipe."""
    if _hushed.get() or not sys.stderr.isatty():
        yield lambda: None
        return
    from rich import progress as bars
    from rich.console import Console

    columns = (
        bars.BarColumn(bar_width=20), bars.TextColumn("{task.completed:,} of {task.total:,} captures"),
        bars.TextColumn("{task.fields[rate]}"), bars.TimeRemainingColumn(), bars.TextColumn("left"),
    )  # fmt: skip
    with bars.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=total, rate="")
        begin = time.monotonic()

        def advance() -> None:
            done = bar.tasks[0].completed + 1
            bar.update(task, completed=done, rate=f"{done / (time.monotonic() - begin):.2g} a second,")

        yield advance


def console(*, stderr: bool = False) -> Console:
    from rich.console import Console

    # File names may have brackets, which are markup to rich.
    console = Console(highlight=False, markup=False, stderr=stderr, quiet=_hushed.get())
    console.push_render_hook(cast("RenderHook", _Harmless()))
    return console


class _Harmless:  # a RenderHook of rich, which is not imported before it is needed
    """Puts escapes for the control characters of whatever is printed, in tables too: names of files may have them."""

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        return [_Escaped(each) for each in renderables]


class _Escaped:
    def __init__(self, renderable: ConsoleRenderable) -> None:
        self._renderable = renderable

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        for segment in console.render(self._renderable, options):
            yield segment if segment.control else segment._replace(text=printable(segment.text))


def print_json(content: Any) -> None:
    unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    typer.echo(json_text(content, ensure_ascii=not unicode))


def note(text: str) -> None:
    if not _hushed.get():
        print(f"matest: note: {printable(text)}", file=sys.stderr)
