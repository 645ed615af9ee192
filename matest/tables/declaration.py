"""What the user says of a table: how its numbers are to be read, and which channels are wanted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

from matest.errors import InputError

# Unit of the angles of a CSV table.
Unit = Literal["rad", "deg"]
# Where the azimuth of the viewer equals that of the light: toward the light (both directions point away from the
# surface), or on the mirror's side (the light's is the one that it travels to).
Azimuth = Literal["retro", "forward"]
# What the values of a CSV table are.
Quantity = Literal["f", "pi-f", "f-cos"]

# What a line of a CSV table may declare, and its words.
READINGS: dict[str, tuple[str, ...]] = {
    "units": get_args(Unit),
    "azimuth": get_args(Azimuth),
    "quantity": get_args(Quantity),
}

# Channels that stand for all wavelengths of a table, or for linear RGB.
EVERY_WAVELENGTH = "all"
RGB = "rgb"
RGB_NOTE = "RGB by the CIE's observer of 1931 under D65, linear, Rec. 709 primaries."


@dataclass(frozen=True)
class Declaration:
    """How to read a table; None: as the file says, or as its values show.

    Attributes:
        units: of the angles of a CSV table.
        azimuth: where viewer and light have the same azimuth in a CSV table.
        quantity: values of a CSV table: f in 1/sr, π f, or f cos θi.
        channels: of a spectral table: "all", "rgb", or wavelengths in nm such as "450,550".

    Raises:
        InputError: a word that is none of these.
    """

    units: Unit | None = None
    azimuth: Azimuth | None = None
    quantity: Quantity | None = None
    channels: str = EVERY_WAVELENGTH

    def __post_init__(self) -> None:
        for name, words in READINGS.items():
            value = getattr(self, name)
            if value is not None and value not in words:
                raise InputError(f"{name} must be one of {', '.join(words)}; got '{value}'.")

    def completed(self, declared: Mapping[str, str]) -> Declaration:
        """With what a file declares, where the user says nothing.

        Raises:
            InputError: a word that is none of those above.
        """
        names = [name for name in READINGS if getattr(self, name) is None and name in declared]
        return replace(self, **{name: declared[name] for name in names})  # type: ignore[arg-type]

    def refuse_reading(self) -> None:
        """Refuse what says how to read a CSV table: other formats leave nothing of it open.

        Raises:
            InputError: there is such a word.
        """
        for name in READINGS:
            if getattr(self, name) is not None:
                raise InputError(f"--{name} says how to read a CSV table, and this format leaves no choice; omit it.")

    def wavelengths(self, present: Sequence[float]) -> list[int] | None:
        """Places of the wanted ones among the wavelengths in nm that are `present`; None: RGB is wanted.

        Raises:
            InputError: a wavelength that is not there, or no number.
        """
        if self.channels == RGB:
            return None
        if self.channels == EVERY_WAVELENGTH:
            return [*range(len(present))]
        try:
            wanted = [float(text) for text in self.channels.split(",")]
        except ValueError:
            raise InputError(
                f"channels are 'all', 'rgb' or wavelengths in nm, as 450,550; got '{self.channels}'."
            ) from None
        if missing := [nm for nm in wanted if nm not in present]:
            raise InputError(
                f"expected the wavelength {missing[0]:g} nm, and the table has {present[0]:g} to {present[-1]:g} nm "
                f"({len(present)} wavelengths); ask for one of these."
            )
        return [present.index(nm) for nm in wanted]
