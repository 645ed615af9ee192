"""What the user says of a table."""

from __future__ import annotations

import pytest

from matest.errors import InputError
from matest.tables import Declaration

PRESENT = [400.0, 450.0, 500.0]


def test_words_are_checked() -> None:
    with pytest.raises(InputError, match="units must be one of rad, deg; got 'grad'"):
        Declaration(units="grad")  # type: ignore[arg-type]


def test_what_the_user_says_comes_before_what_the_file_says() -> None:
    said = Declaration(units="rad").completed({"units": "deg", "quantity": "f-cos"})
    assert (said.units, said.quantity, said.azimuth) == ("rad", "f-cos", None)
    with pytest.raises(InputError, match="quantity must be one of"):
        Declaration().completed({"quantity": "radiance"})


def test_wavelengths_are_chosen_by_number() -> None:
    assert Declaration().wavelengths(PRESENT) == [0, 1, 2]
    assert Declaration(channels="rgb").wavelengths(PRESENT) is None
    assert Declaration(channels="500, 400").wavelengths(PRESENT) == [2, 0]
    with pytest.raises(InputError, match="expected the wavelength 455 nm, and the table has 400 to 500 nm"):
        Declaration(channels="455").wavelengths(PRESENT)
    with pytest.raises(InputError, match="channels are 'all', 'rgb' or wavelengths"):
        Declaration(channels="blue").wavelengths(PRESENT)
