"""What each number of photographs allows of maps, as the terminal shows it."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console, Group

from matest.identifiability import MapForecast, MappedParameter, MapsForecast, SomePhotographs
from matest.report.map_forecast import maps_report

PARAMETERS = {
    "oren-nayar.albedo": MappedParameter([0.5, 0.4], "1", False, 0.5),
    "oren-nayar.sigma": MappedParameter(0.4, "rad", True, 0.25),
}


def forecast(known: float, low: float, high: float, relative: float) -> MapForecast:
    return MapForecast(known, (low, high), (relative / 2, relative, 2 * relative), (relative, relative))


def some(
    images: list[int], albedo: MapForecast, sigma: MapForecast, errors: tuple[float | None, ...]
) -> SomePhotographs:
    specular, as_one = errors
    maps = {"oren-nayar.albedo": albedo, "oren-nayar.sigma": sigma}
    return SomePhotographs(images, 0.9, maps, {"torrance-sparrow.specular": specular}, {"oren-nayar.sigma": as_one})


BRIGHT = forecast(0.88, 0.88, 0.88, 0.02)
ROWS = [
    some([2], BRIGHT, forecast(0.0, 0.0, 0.0, 4.0), (None, None)),
    some([2, 0], BRIGHT, forecast(0.3, 0.1, 0.5, 0.3), (0.04, 0.01)),
    some([2, 0, 1], BRIGHT, forecast(0.6, 0.3, 0.7, 0.2), (0.02, 0.005)),
]


def words(rows: list[SomePhotographs], *, relative: bool = False) -> str:
    console = Console(file=StringIO(), width=80, highlight=False)
    console.print(Group(*maps_report(MapsForecast(PARAMETERS, rows, relative, 1_000))))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert max(len(line) for line in text.splitlines()) <= 80
    return " ".join(text.split())


def test_a_row_has_shares_of_pixels_and_errors() -> None:
    told = words(ROWS)
    assert "2 88%, ± 2% 30%, ± 30% ± 4% ± 1%" in told
    assert "1 88%, ± 2% 0%, > 100% - -" in told


def test_one_photograph_tells_albedos_for_given_shapes() -> None:
    assert (
        "One photograph tells albedo at 88% of the object's pixels (it lights 90%), for a given specular and sigma, "
        "which it does not tell."
    ) in words(ROWS)
    alike = [some([2], BRIGHT, forecast(0.0, 0.0, 0.0, 4.0), (0.03, 0.02))]
    assert "with one specular (± 3%) and sigma (± 2%) of the whole object." in words(alike)


def test_a_map_needs_so_many_photographs_and_more_or_fewer_over_the_range() -> None:
    told = words(ROWS)
    assert "sigma needs 3 photographs to be known at half of the lit pixels (2 to more than 3 over the range)." in told
    assert "specular, in common to all pixels, needs 2 photographs." in told
    assert "as estimate decides" in told
    assert "each beside those before it: 2, 0, 1." in told


def test_what_stays_common_is_told_so() -> None:
    told = words(ROWS[:2])
    assert (
        "sigma stays common to most pixels: all 2 photographs tell it at 30% of the object's pixels (10% to 50% over "
        "the range); the others take the object's (± 1%)."
    ) in told
    assert "specular, in common to all pixels, is not determined by these photographs" in words(ROWS[:1])


@pytest.mark.parametrize("relative", [True, False])
def test_maps_are_known_up_to_the_scale_of_lights_of_unknown_strength(relative: bool) -> None:
    assert ("The map of albedo is known up to one scale" in words(ROWS, relative=relative)) == relative
