"""Plots of cross-sections."""

from __future__ import annotations

from pathlib import Path

import matplotlib.axes
import numpy as np
import pytest

from matest.photographs.images import read_image
from matest.profiles import Comparison, compare
from matest.report.plots import plot_profiles


def comparison(count: int = 2, offset: float = 0.0) -> Comparison:
    rows, columns = np.indices((5, 40))
    images = [np.sin(columns / 6 + k) + 1 + 0 * rows + offset for k in range(count)]
    return compare(images, [f"image {k}" for k in range(count)], (0, 2, 39, 2))


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[tuple[tuple, dict]]:
    """What is handed to matplotlib's plot."""
    calls: list[tuple[tuple, dict]] = []
    plot = matplotlib.axes.Axes.plot

    def spy(self: matplotlib.axes.Axes, *args: object, **options: object) -> object:
        calls.append((args, options))
        return plot(self, *args, **options)

    monkeypatch.setattr(matplotlib.axes.Axes, "plot", spy)
    return calls


def test_a_plot_is_a_picture_that_shows_something(tmp_path: Path) -> None:
    plot_profiles(comparison(), tmp_path / "profile.png")
    picture = read_image(tmp_path / "profile.png")
    assert picture.shape[0] > 200
    assert picture.shape[1] > 400
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10


def test_every_image_has_its_own_curve(tmp_path: Path, drawn: list) -> None:
    shown = comparison(9)
    plot_profiles(shown, tmp_path / "profile.png")
    assert len(drawn) == 9
    for (x, y, *_), profile in zip((args for args, _ in drawn), shown.profiles, strict=True):
        np.testing.assert_array_equal(x, shown.distance)
        np.testing.assert_array_equal(y, profile)
    assert len({(args[2], options["color"]) for args, options in drawn}) == 9


def test_the_legend_tells_how_far_each_curve_is_from_the_first(tmp_path: Path, drawn: list) -> None:
    shown = comparison()
    plot_profiles(shown, tmp_path / "profile.png")
    assert [options["label"] for _, options in drawn] == ["image 0", f"image 1 (rms {shown.rms[1]:.3g})"]


def test_negative_values_are_not_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limits: list[float] = []
    original = matplotlib.axes.Axes.set_ylim

    def spy(self: matplotlib.axes.Axes, *args: object, **options: float) -> object:
        if "bottom" in options:
            limits.append(options["bottom"])
        return original(self, *args, **options)

    monkeypatch.setattr(matplotlib.axes.Axes, "set_ylim", spy)
    shown = comparison(offset=-1.5)
    plot_profiles(shown, tmp_path / "a.png")
    plot_profiles(comparison(offset=0.5), tmp_path / "b.png")
    assert limits == [pytest.approx(shown.profiles.min()), 0.0]


def test_plotting_does_not_touch_the_callers_figures(tmp_path: Path) -> None:
    from matplotlib import pyplot

    before = pyplot.get_fignums()
    plot_profiles(comparison(), tmp_path / "profile.png")
    assert pyplot.get_fignums() == before


def test_names_with_dollar_signs_are_shown_as_they_are(tmp_path: Path) -> None:
    shown = comparison()
    shown.names[:] = ["a$b", "c$^{$d"]
    plot_profiles(shown, tmp_path / "profile.png")
    assert (tmp_path / "profile.png").is_file()
