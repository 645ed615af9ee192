"""The command `matest`: its commands by the catalogue, and exit codes."""

from __future__ import annotations

import importlib
import io
import sys
from typing import Annotated, Any

import typer

import matest
from matest import commands
from matest.errors import BAD_INPUT, WORK_FAILED, InputError

# Of typer's own in some versions, of click in others.
_UsageError: Any = typer.BadParameter.__base__
# What typer makes of a KeyboardInterrupt.
_INTERRUPTED = 130


def main() -> None:
    """Run the command: exit code 0, 1 (the work failed) or 2 (bad input)."""
    for stream in (sys.stdout, sys.stderr):
        # A terminal or a locale may lack ± and σ, and file names may be no text.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        code = application()(prog_name="matest", standalone_mode=False)
    except InputError as error:
        _fail(str(error), BAD_INPUT)
    except _UsageError as error:
        command = error.ctx.command_path if error.ctx else "matest"
        _fail(f"{error.format_message().rstrip('.')}; see '{command} -h'.", BAD_INPUT)
    except OSError as error:
        _fail(f"{error.filename or 'file system'}: {error.strerror or error}.", WORK_FAILED)
    except KeyboardInterrupt:
        code = _INTERRUPTED
    if code == _INTERRUPTED:
        _fail("interrupted; what was not finished was not written.", WORK_FAILED)
    sys.exit(code)


def application() -> typer.Typer:
    """The commands of the catalogue, each from its file."""
    app = typer.Typer(
        add_completion=False,
        rich_markup_mode=None,  # boxes around the help would take longer than the help
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        help="What a surface is made of, with error bars, from photographs of an object whose shape and lights are "
        "known.",
    )
    app.callback(invoke_without_command=True)(_root)
    for name in commands.COMMANDS:
        module = importlib.import_module(f"matest.commands.{name}")
        app.command(epilog=f"Example: {module.EXAMPLE}")(getattr(module, name))
    return app


def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
) -> None:
    if version:
        typer.echo(f"matest {matest.__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def _fail(text: str, code: int) -> None:
    print(f"matest: {text}", file=sys.stderr)
    sys.exit(code)
