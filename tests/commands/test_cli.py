"""The command line: catalogue, help, exit codes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from matest import commands
from tests.commands.conftest import Run
from tests.signalled import hearing

# A whole command as its file holds it.
GREETING = '''"""The command `matest greet`."""

import os
from typing import Annotated

import typer

from matest.commands import arguments
from matest.commands.console import print_json
from matest.errors import InputError

EXAMPLE = "matest greet Fresnel"


def greet(name: Annotated[str, typer.Argument(help="Whom.")], as_json: arguments.Json = False) -> None:
    """Greet somebody.

    At length.
    """
    if name == "nobody":
        raise InputError("nobody cannot be greeted; name somebody.")
    if name == "late":
        raise KeyboardInterrupt
    if name == "absurd":
        print(1 / 0)
    if name == "greedy":
        raise MemoryError
    if name == "away":
        os.stat("away")
    print_json({"hello": name})
'''


@pytest.fixture
def greeting(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A further command: one file, and one line in the catalogue."""
    (tmp_path / "greet.py").write_text(GREETING, "utf-8")
    monkeypatch.setattr(commands, "__path__", [*commands.__path__, str(tmp_path)])
    monkeypatch.setattr(commands, "COMMANDS", (*commands.COMMANDS, "greet"))
    monkeypatch.delitem(sys.modules, "matest.commands.greet", raising=False)


@pytest.mark.usefixtures("greeting")
def test_a_new_command_is_one_file_and_one_line(run: Run) -> None:
    assert "greet      Greet somebody." in run("--help")[1]
    assert "Example: matest greet Fresnel" in run("greet", "--help")[1]
    assert run("greet", "Fresnel", "--json") == (0, '{"hello": "Fresnel"}\n', "")


@pytest.mark.usefixtures("greeting")
@pytest.mark.parametrize(
    ("name", "code", "error"),
    [
        ("nobody", 2, "matest: nobody cannot be greeted; name somebody.\n"),
        ("away", 1, "matest: away: No such file or directory.\n"),
        ("late", 1, "matest: interrupted; what was not finished was not written.\n"),
    ],
)
def test_the_exit_code_says_whether_the_input_or_the_work_failed(run: Run, name: str, code: int, error: str) -> None:
    ended, out, err = run("greet", name)
    assert (ended, out) == (code, "")
    assert err.lstrip().endswith(error)


def test_commands_are_listed_in_the_order_of_the_catalogue(run: Run) -> None:
    listed = run("--help")[1].partition("Commands:\n")[2].splitlines()
    assert [line.split()[0] for line in listed] == list(commands.COMMANDS)
    assert run() == run("--help")


def test_tables_fit_an_eighty_column_terminal(run: Run, capture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    plain = ("estimate", capture, "--model", "oren-nayar")
    refined = (*plain, "--refine", "albedo_field,direction", "--uncertainty", "pose=0.1,0.1deg")
    for arguments in (plain, refined, ("models",)):
        _, out, _ = run(*arguments)
        assert max(len(line.rstrip()) for line in out.splitlines() if str(capture) not in line) <= 80


def test_help_loads_nothing_heavy() -> None:
    heavy = "torch|cv2|trimesh|skimage|matplotlib|scipy|kornia|numpy"
    code = (
        "import sys, matest\n"
        f"assert not [m for m in sys.modules if m.split('.')[0] in '{heavy}'.split('|')]\n"
        "from matest.cli import main\n"
        "sys.argv = ['matest', '--help']\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        f"assert not [m for m in sys.modules if m.split('.')[0] in '{heavy}'.split('|')]\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "estimate" in done.stdout


@pytest.mark.parametrize("command", commands.COMMANDS)
def test_every_command_has_help_with_an_example(run: Run, command: str) -> None:
    code, out, _ = run(command, "--help")
    assert code == 0
    assert f"Example: matest {command}" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("estimate",), "Missing argument 'CAPTURE...'; see 'matest estimate -h'."),
        (("estimate", "x", "--modle", "lambert"), "No such option: --modle"),
        (("estimate", "x", "--seed", "1.5"), "Invalid value for '--seed'"),
        (("nope",), "No such command 'nope'; see 'matest -h'."),
    ],
)
def test_a_command_that_cannot_be_read_is_refused_in_one_line(run: Run, arguments: tuple[str, ...], words: str) -> None:
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("matest: ")
    assert words in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_what_a_terminal_cannot_show_is_replaced(capture: Path, encoding: str) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    command = [sys.executable, "-m", "matest", "estimate", str(capture), "--model", "oren-nayar"]
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert b"albedo R" in done.stdout


def test_brackets_in_the_name_of_a_folder_are_no_markup(run: Run, capture: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run[final]x"
    code, out, _ = run("estimate", capture, "--model", "lambert", "-o", folder)
    assert code == 0
    assert f"Result in {folder} (open {folder / 'report.html'})" in out


def matest(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "matest", *arguments]


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams_leave_the_exit_code(closed: str) -> None:
    command = f"{sys.executable} -m matest models lambert {closed}"
    assert subprocess.run(["bash", "-c", command], capture_output=True, check=False).returncode == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no stream that takes nothing")
def test_a_sentence_that_nobody_takes_leaves_the_exit_code() -> None:
    command = f"{sys.executable} -m matest models nothing 2>/dev/full"
    assert subprocess.run(["bash", "-c", command], check=False).returncode == 2


def test_a_reader_that_goes_gets_one_sentence() -> None:
    command = f"{sys.executable} -m matest models | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.count("\n")) in ((0, 0), (1, 1))
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("kind", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_signals_to_end_are_obeyed_and_leave_nothing(capture: Path, kind: int) -> None:
    before = sorted(capture.rglob("*"))
    command = matest("estimate", str(capture), "--model", "oren-nayar+cook-torrance", "--refine", "all")
    with hearing(command) as process:
        # Until it has begun to work: then it has the right to write its result.
        while not [*capture.glob(".*lock*")]:
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(kind)
        _, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert err == "matest: interrupted; what was not finished was not written.\n"
    assert sorted(capture.rglob("*")) == before


@pytest.mark.usefixtures("greeting")
@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("absurd", "this is a fault of matest, please report it: ZeroDivisionError: division by zero."),
        ("greedy", "there is not enough memory for this; close other programs, or give fewer or smaller images."),
    ],
)
def test_what_nobody_expected_is_one_sentence(run: Run, name: str, sentence: str) -> None:
    code, out, err = run("greet", name)
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert err.startswith(f"matest: {sentence}")


def test_control_characters_in_a_name_are_not_obeyed(run: Run) -> None:
    _, _, err = run("estimate", "\x1b[31mred")
    assert "\x1b" not in err
    assert r"\x1b[31mred" in err


def test_a_signal_after_the_work_changes_nothing() -> None:
    code = "import os, signal, sys, atexit; from matest import cli; sys.argv = ['matest', '--version']; "
    code += "atexit.register(os.kill, os.getpid(), signal.SIGINT); cli.main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("matest ")


def test_what_decoders_print_of_a_damaged_file_is_not_seen(tmp_path: Path) -> None:
    import cv2
    import numpy as np

    damaged = bytearray(cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes())
    damaged[damaged.index(b"IDAT") + 8] ^= 255
    (tmp_path / "a.png").write_bytes(damaged)
    code = "from matest.cli import main; main()"
    command = [sys.executable, "-c", code, "compare", "a.png", "a.png"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("matest: a.png: the image cannot be read")
    assert done.stderr.count("\n") == 1
