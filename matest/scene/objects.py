"""Which of several objects each pixel of a surface shows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from matest.errors import InputError, nearest
from matest.scene.rim import near_silhouette


@dataclass(frozen=True, eq=False)
class Objects:
    """The objects that the N pixels of a surface show.

    Attributes:
        names: of the objects.
        index: number of the object of each pixel, uint8 [N].
    """

    names: tuple[str, ...]
    index: np.ndarray

    def take(self, selection: np.ndarray) -> Objects:
        """The same objects at some of the pixels (boolean or indices)."""
        return replace(self, index=self.index[selection])

    def pixels_of(self, number: int) -> np.ndarray:
        """Which pixels show an object, boolean [N]."""
        return np.asarray(self.index == number)

    @property
    def seen(self) -> dict[str, int]:
        """Names and numbers of the objects that any pixel shows."""
        return {name: number for number, name in enumerate(self.names) if self.pixels_of(number).any()}

    @property
    def notes(self) -> list[str]:
        """What is to know of a picture of them, in sentences."""
        between = "Light that one object sends to another is not modelled; the shadows between them are."
        hidden = [name for name in self.names if name not in self.seen]
        sentence = f"No pixel shows {', '.join(hidden)}: outside the image or the mask, or behind the others."
        return [between, *([sentence] if hidden else [])]

    def number(self, name: str | None, label: str) -> int:
        """The number of an object.

        Args:
            name: of the object; None: the only one.
            label: begins the refusal.

        Raises:
            InputError: no object of that name is seen, or there are several and none is named.
        """
        if name is None and len(self.names) > 1:
            raise InputError(
                f"{label}: shows several objects ({', '.join(self.names)}), each of a material of its own; choose one, "
                "in Python as capture.objects[NAME], in a command with --object NAME."
            )
        chosen = self.names[0] if name is None else name
        if chosen not in self.names:
            raise InputError(f"{label}: shows no object '{chosen}'; {nearest(chosen, self.names)}")
        if chosen not in self.seen:
            raise InputError(
                f"{label}: no pixel shows the object '{chosen}'; it lies outside the image or the mask, or behind the "
                "others."
            )
        return self.names.index(chosen)

    def borders(self, shape: tuple[int, int], pixels: np.ndarray) -> np.ndarray:
        """True for pixels that may mix an object with another one, or with the background [N].

        Args:
            shape: of the image (H, W).
            pixels: flat row-major indices, ascending [N].
        """
        rim = np.zeros(len(pixels), dtype=bool)
        for number in self.seen.values():
            here = self.pixels_of(number)
            rim[here] = near_silhouette(shape, pixels[here])
        return rim
