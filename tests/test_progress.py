"""One protocol for what long work tells of itself."""

from __future__ import annotations

from pathlib import Path

import pytest

import matest
from matest.progress import silent
from matest.simulate import simulate
from tests import scenes


class Diary:
    """A progress callback that keeps what it is told."""

    def __init__(self) -> None:
        self.entries: list[tuple[str, int | None, int | None]] = []

    def __call__(self, what: str, done: int | None = None, total: int | None = None) -> None:
        assert isinstance(what, str)
        if done is not None and total is not None:
            assert 0 <= done <= total
        self.entries.append((what, done, total))

    @property
    def words(self) -> list[str]:
        """What was told, repetitions once."""
        return list(dict.fromkeys(what for what, _, _ in self.entries))


def test_one_callback_serves_rendering_reading_estimating_and_checking(tmp_path: Path) -> None:
    material = scenes.material("lambert", albedo=0.5)
    scenes.write(tmp_path, material, scenes.sphere(32), scenes.noise(), scenes.distant(scenes.LIGHTS[:2]))
    diary = Diary()
    simulate(tmp_path, tmp_path / "ball", diary)
    capture = matest.load_capture(tmp_path / "ball", progress=diary)
    matest.estimate(capture, "lambert", progress=diary)
    matest.check(matest.load_plan(tmp_path / "ball", progress=diary), "lambert", progress=diary)
    assert diary.words == [
        "rendering images",
        "reading images",
        "searching",
        "refining over all samples",
        "looking for causes of residuals",
        "predicting photographs",
        "trying lights",
        "comparing with the photographs",
    ]
    assert ("rendering images", 2, 2) in diary.entries
    assert diary.entries.count(("reading images", 2, 2)) == 2


def test_the_default_tells_nobody(capfd: pytest.CaptureFixture[str]) -> None:
    silent("searching")
    silent("reading images", 1, 2)
    assert capfd.readouterr() == ("", "")
