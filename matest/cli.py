"""The command `matest`: its commands by the catalogue, and exit codes."""

from __future__ import annotations

import atexit
import functools
import importlib
import inspect
import io
import os
import sys
import warnings
from collections.abc import Callable
from typing import Annotated, Any

import typer

import matest
from matest import commands, interruption
from matest.commands.arguments import Quiet
from matest.commands.console import hushed
from matest.errors import BAD_INPUT, NO_MEMORY, WORK_FAILED, InputError, WorkError, out_of_memory, own_fault, printable

# Of typer's own in some versions, of click in others.
_UsageError: Any = typer.BadParameter.__base__
# What typer makes of a KeyboardInterrupt.
_INTERRUPTED = 130
# Variable of the environment that asks for the place of faults of our own.
_DEBUG = "MATEST_DEBUG"
# Number of standard output.
_OUTPUT = 1
# Number of standard error.
_ERRORS = 2


def main() -> None:
    """Run the command: exit code 0, 1 (the work failed) or 2 (bad input)."""
    _open_streams()
    _hush_libraries()
    # They are for programmers.
    warnings.simplefilter("ignore")
    try:
        with interruption.watched():
            code = application()(prog_name="matest", standalone_mode=False)
    except InputError as error:
        _fail(str(error), BAD_INPUT)
    except _UsageError as error:
        command = error.ctx.command_path if error.ctx else "matest"
        _fail(f"{error.format_message().rstrip('.')}; see '{command} -h'.", BAD_INPUT)
    except (BrokenPipeError, SystemExit):
        # typer ends so where who reads the output has gone.
        # What is still to be printed would fail again at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), _OUTPUT)
        _fail("standard output was closed before everything was printed; what was to be written was.", WORK_FAILED)
    except OSError as error:
        _fail(f"{error.filename or 'file system'}: {error.strerror or error}.", WORK_FAILED)
    except WorkError as error:
        _fail(str(error), WORK_FAILED)
    except KeyboardInterrupt:
        code = _INTERRUPTED
    except Exception as error:
        _fail(NO_MEMORY if out_of_memory(error) else _own_fault(error), WORK_FAILED)
    finally:
        # The work has ended: a signal that comes while Python takes itself apart would only print where.
        atexit.register(interruption.leave)
    if code == _INTERRUPTED:
        _fail(interruption.SENTENCE, WORK_FAILED)
    sys.exit(code)


def _open_streams() -> None:
    """Streams that take any text, and that are open.

    Where one is closed, a file that is opened later takes its number, and gets what a library prints.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= _ERRORS:
        continue
    os.close(number)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            # A terminal or a locale may lack ± and σ, and file names may be no text.
            stream.reconfigure(errors="replace")


def _hush_libraries() -> None:
    """Let standard error be Python's alone: decoders print there what they think of a damaged file."""
    stream = sys.stderr
    # Whoever runs the command inside of Python has a stream of his own.
    if isinstance(stream, io.TextIOWrapper) and stream is sys.__stderr__ and _DEBUG not in os.environ:
        own = os.dup(_ERRORS)
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, _ERRORS)
        os.close(null)
        sys.stderr = open(own, "w", encoding=stream.encoding, errors=stream.errors, buffering=1)  # noqa: SIM115


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
        app.command(epilog=f"Example: {module.EXAMPLE}")(_with_quiet(getattr(module, name)))
    return app


def _with_quiet(command: Callable[..., None]) -> Callable[..., None]:
    """A command with one more option, `--quiet`."""

    @functools.wraps(command)
    def run(*, quiet: bool, **options: Any) -> None:
        with hushed(quiet):
            command(**options)

    option = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Quiet)
    options = [*inspect.signature(command, eval_str=True).parameters.values(), option]
    run.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    run.__annotations__ = {option.name: option.annotation for option in options}
    return run


def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
) -> None:
    if version:
        typer.echo(f"matest {matest.__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def _own_fault(error: Exception) -> str:
    """What to say of an exception that nobody expected; raised instead where its place is wanted.

    Raises:
        Exception: the environment asks for it.
    """
    if os.environ.get(_DEBUG):
        raise error
    return f"{own_fault(error)} {_DEBUG}=1 in the environment shows where."


def _fail(text: str, code: int) -> None:
    try:
        print(f"matest: {printable(text)}", file=sys.stderr, flush=True)
    except (OSError, ValueError):
        # Who closed it wants no words, but the exit code all the same: at its end Python would try again.
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    sys.exit(code)
