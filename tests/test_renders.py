"""The captures that ship in `renders/` are what their scenes give, bit for bit."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from matest.simulate import simulate

RENDERS = Path(__file__).parents[1] / "renders"
SCENES = sorted(path.parent.name for path in RENDERS.glob("*/scene.toml"))


@pytest.mark.parametrize("name", SCENES)
def test_rebuilding_a_capture_changes_no_bit(name: str, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(RENDERS / name, tmp_path / name, ignore=shutil.ignore_patterns("matest*")))
    shipped = {path.name: path.read_bytes() for path in copy.iterdir() if path.is_file()}
    for path in copy.glob("0*.png"):
        path.unlink()
    simulate(copy)
    assert {path.name: path.read_bytes() for path in copy.iterdir()} == shipped
    assert {"capture.toml", "mask.png", "normals.exr", "00.png"} <= set(shipped)
