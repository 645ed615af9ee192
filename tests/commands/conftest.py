"""Fixtures of the commands: running one in this process, and a small capture to run it on."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from matest import cli
from matest.simulate import simulate
from tests import scenes

# Exit code, standard output and standard error of `matest ARGUMENTS`.
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Run:
    """Run `matest ARGUMENTS` in this process: exit code, standard output, standard error."""

    def invoke(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["matest", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capfd.readouterr()
        code = ended.value.code
        return (0 if code is None else int(code)), out, err

    return invoke


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small capture of an Oren-Nayar ball."""
    folder = tmp_path_factory.mktemp("made")
    material = scenes.material("oren-nayar", albedo=[0.6, 0.5, 0.4], sigma=0.4)
    scenes.write(folder / "scene", material, scenes.sphere(64), scenes.noise(), scenes.distant(scenes.LIGHTS[:3]))
    return simulate(folder / "scene", folder / "ball")


@pytest.fixture
def capture(made: Path, tmp_path: Path) -> Path:
    """A copy of it to spoil."""
    return Path(shutil.copytree(made, tmp_path / "ball"))
