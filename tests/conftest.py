"""Fixtures shared by all tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.captures import CaptureFolder, sphere_folder


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240501)


@pytest.fixture
def folder(tmp_path: Path) -> CaptureFolder:
    """A good capture of a Lambertian sphere, not yet saved."""
    return sphere_folder(tmp_path)
