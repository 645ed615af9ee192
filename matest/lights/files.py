"""Lists of lights as other captures and programs read them."""

from __future__ import annotations

import json
from pathlib import Path

from matest.errors import InputError
from matest.lights.lights import Light, Lights
from matest.lights.strengths import Strengths

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
    if file.exists() and not (file.is_file() and file.read_bytes().startswith(_HEADER.encode("utf-8"))):
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


def write_capture_tables(lights: Lights, file: Path, strengths: Strengths | None = None) -> None:
    """Write the `[uncertainty]` and `[[image]]` tables of a capture.toml, and what they need of `[encoding]`.

    Args:
        lights: where they are.
        file: to write.
        strengths: how strong they are; None: not known.
    """
    stated = [f"{name} = {std:.2g}  # rad" for name, std in lights.uncertainty.items() if std > 0]
    encoding = []
    if strengths is not None:
        stated.append(f"intensity = {strengths.uncertainty:.2g}  # relative")
        encoding = ["[encoding]", 'radiometry = "relative"  # strengths are known up to one common factor', ""]
    images = []
    for number, (light, extent) in enumerate(zip(lights.lights, lights.extents, strict=True)):
        keys = [_place(light)]
        if strengths is not None:
            key = "irradiance" if light.position is None else "intensity"
            keys.append(f"{key} = {_power(strengths.power[number].tolist())}")
        note = ""
        if extent is not None and extent.std is not None:
            keys.append(f"solid_angle = {extent.solid_angle:.4g}")
            note = f"  # solid angle ± {extent.std:.2g} sr"
        elif extent is not None:
            note = f"  # solid angle at most {extent.solid_angle:.2g} sr"
        images.append(f"[[image]]\nfile = {_text(light.name)}\nlights = [ {{ {', '.join(keys)} }} ]{note}\n")
    file.write_text("\n".join([_HEADER, *encoding, "[uncertainty]", *stated, "", *images]), "utf-8")


def _place(light: Light) -> str:
    if light.position is not None:
        return f"position = {_vector(light.position.point.tolist())}"
    return f"direction = {_vector(light.direction.tolist())}"


def _vector(numbers: list[float]) -> str:
    return f"[{', '.join(f'{number:.{_DECIMALS}f}' for number in numbers)}]"


def _power(numbers: list[float]) -> str:
    digits = [f"{number:.5g}" for number in numbers]
    return f"[{', '.join(digits)}]" if len(digits) > 1 else digits[0]


def _text(name: str) -> str:
    """A basic string of TOML, which escapes as JSON does."""
    return json.dumps(name.encode("utf-8", "backslashreplace").decode("utf-8"), ensure_ascii=False)
