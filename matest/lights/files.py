"""Lists of lights as other captures and programs read them."""

from __future__ import annotations

import json
from pathlib import Path

from matest.errors import InputError
from matest.lights.lights import Light, Lights

# Written to the file with tables for a capture.toml.
_HEADER = """\
# Lights by matest: move these tables to the capture.toml of an object under the same lights, and name its photographs.
"""
# Decimals of directions: 1e-6 is a thousandth of their errors.
_DECIMALS = 6


def check_tables(file: Path) -> None:
    """Refuse to write tables over a file that is none of `write_capture_tables`, such as an object's capture.toml.

    Raises:
        InputError: there is another file.
    """
    if file.exists() and not file.read_bytes().startswith(_HEADER.encode("utf-8")):
        raise InputError(
            f"{file}: exists and would be overwritten by the tables of the lights; write elsewhere with -o."
        )


def write_light_list(lights: Lights, file: Path) -> None:
    """Write an RTI light list: the count, then name and direction of each."""
    rows = [
        f"{light.name} {' '.join(f'{number:.{_DECIMALS}f}' for number in light.direction)}" for light in lights.lights
    ]
    # Names of files need not be text.
    file.write_text("\n".join([str(len(rows)), *rows]) + "\n", "utf-8", errors="surrogateescape")


def write_capture_tables(lights: Lights, file: Path) -> None:
    """Write the `[uncertainty]` and `[[image]]` tables of a capture.toml."""
    stated = [f"{name} = {std:.2g}  # rad" for name, std in lights.uncertainty.items() if std > 0]
    images = [f"[[image]]\nfile = {_text(light.name)}\nlights = [ {{ {_place(light)} }} ]\n" for light in lights.lights]
    file.write_text("\n".join([_HEADER, "[uncertainty]", *stated, "", *images]), "utf-8")


def _place(light: Light) -> str:
    if light.position is not None:
        return f"position = {_vector(light.position.point.tolist())}"
    return f"direction = {_vector(light.direction.tolist())}"


def _vector(numbers: list[float]) -> str:
    return f"[{', '.join(f'{number:.{_DECIMALS}f}' for number in numbers)}]"


def _text(name: str) -> str:
    """A basic string of TOML, which escapes as JSON does."""
    return json.dumps(name.encode("utf-8", "backslashreplace").decode("utf-8"), ensure_ascii=False)
