"""Fixtures shared by all tests, and how tests share the processors."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import torch

from matest.workers import processors
from tests.captures import CaptureFolder, sphere_folder

if "PYTEST_XDIST_WORKER" in os.environ:
    # Every processor has a worker. Tests of what threads do to a result set their number themselves.
    torch.set_num_threads(1)


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """One worker a processor; none for tests that are named one by one, which end before a worker has started."""
    return 0 if all("::" in argument for argument in config.args) else processors()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240501)


@pytest.fixture
def folder(tmp_path: Path) -> CaptureFolder:
    """A good capture of a Lambertian sphere, not yet saved."""
    return sphere_folder(tmp_path)
