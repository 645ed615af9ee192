"""Correlations, drawn."""

from __future__ import annotations

from matest.report.correlations import correlations
from tests.estimates import clay
from tests.report.pages import read, words


def matrix(count: int, value: float) -> list[list[float]]:
    return [[1.0 if i == j else value for j in range(count)] for i in range(count)]


def test_every_pair_has_a_cell_with_its_number() -> None:
    drawn = correlations(clay())
    assert drawn.count("<rect") == 16
    assert drawn.count(">0.50</text>") == 12
    assert "albedo G" in words(drawn)


def test_the_closest_pair_is_named_and_what_it_means() -> None:
    values = matrix(4, 0.1)
    values[3][1] = values[1][3] = -0.97
    said = words(correlations(clay(correlation=values)))
    assert "Errors of albedo G and sigma hang together most: correlation -0.97." in said
    assert "1 of 6 pairs" in said
    assert "opposite directions" in said
    assert "Beyond" not in words(correlations(clay()))


def test_signs_have_colours() -> None:
    assert 'class="cell minus"' in correlations(clay(correlation=matrix(4, -0.5)))
    assert 'class="cell minus"' not in correlations(clay())


def test_numbers_on_deep_colours_are_bright() -> None:
    assert correlations(clay(correlation=matrix(4, 0.9))).count('<text class="bright"') == 12
    assert "bright" not in correlations(clay(correlation=matrix(4, 0.8)))


def test_names_are_text() -> None:
    drawn = correlations(clay(labels=["<b>x", "a", "b", "c"]))
    assert "b" not in read(drawn).tags


def test_too_many_for_a_drawing_are_told_in_words_and_one_alone_not_at_all() -> None:
    many = clay(labels=[str(k) for k in range(30)], correlation=matrix(30, 0.2))
    assert "<svg" not in correlations(many)
    assert "all 30" in correlations(many)
    assert correlations(clay(labels=["a"], correlation=[[1.0]])) == ""
