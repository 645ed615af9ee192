"""What the commands show: a progress bar, tables, JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

import typer

if TYPE_CHECKING:
    from rich.console import Console


class Say(Protocol):
    """Tells what is being done, and how much of it."""

    def __call__(self, word: str, done: int | None = None, total: int | None = None) -> None: ...


@contextmanager
def progress(title: str) -> Iterator[Say]:
    """A progress bar with a word on what is being done; nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), BarColumn(bar_width=20), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)

        def say(word: str, done: int | None = None, total: int | None = None) -> None:
            bar.update(task, description=f"{title}: {word}", completed=done or 0, total=total)

        yield say


def console(*, stderr: bool = False) -> Console:
    from rich.console import Console

    return Console(highlight=False, stderr=stderr)


def print_json(content: Any) -> None:
    typer.echo(json.dumps(content, ensure_ascii=False))


def note(text: str) -> None:
    print(f"matest: note: {text}", file=sys.stderr)
