"""The fixture that most tests of checks use."""

from __future__ import annotations

import pytest


@pytest.fixture
def without_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search for the next light takes longer than all else."""
    monkeypatch.setattr("matest.identifiability.advice.next_light", lambda *_: None, raising=True)
