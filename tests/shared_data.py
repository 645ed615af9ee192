"""Measured and hand-made data that lie beside the checkout; tests that need them skip where they are absent."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

_DATA = Path(__file__).parents[2] / "shared" / "data"


def shared(case: str) -> tuple[Path, dict[str, Any]]:
    """The folder of a small capture, and what it was made from."""
    folder = _DATA / "cases" / case
    if not folder.is_dir():
        pytest.skip(f"{folder} is not here")
    return folder, json.loads((folder / "truth.json").read_text("utf-8"))


def measurement(folder: str, file: str) -> Path:
    """A measured file."""
    path = _DATA / folder / file
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    return path
