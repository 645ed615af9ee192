"""Image files written byte by byte or by other libraries, to check readers independently of OpenCV and OpenEXR."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np


def write_exr(path: Path, channels: dict[str, np.ndarray]) -> None:
    """An uncompressed scan-line OpenEXR file; channels are float16 or float32 planes of one size."""
    names = sorted(channels)  # the format stores channels in alphabetical order
    height, width = channels[names[0]].shape
    kinds = {np.dtype(np.float16): 1, np.dtype(np.float32): 2}
    listed = b"".join(
        name.encode() + b"\0" + struct.pack("<iB3xii", kinds[channels[name].dtype], 0, 1, 1) for name in names
    )
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    header = struct.pack("<ii", 20000630, 2)
    for name, kind, value in [
        ("channels", "chlist", listed + b"\0"),
        ("compression", "compression", b"\0"),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", b"\0"),
        ("pixelAspectRatio", "float", struct.pack("<f", 1)),
        ("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1)),
    ]:
        header += name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value
    header += b"\0"
    lines = []
    for row in range(height):
        data = b"".join(channels[name][row].tobytes() for name in names)
        lines.append(struct.pack("<ii", row, len(data)) + data)
    start = len(header) + 8 * height
    offsets = [start + sum(len(line) for line in lines[:row]) for row in range(height)]
    path.write_bytes(header + struct.pack(f"<{height}Q", *offsets) + b"".join(lines))


def write_hdr(path: Path, mantissa: np.ndarray, exponent: np.ndarray) -> np.ndarray:
    """A flat Radiance RGBE file of `mantissa` H×W×3 (uint8) and `exponent` H×W (uint8); returns its values.

    The width must be below 8, so that no reader takes the pixels for run lengths.
    """
    height, width, _ = mantissa.shape
    assert width < 8
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    path.write_bytes(header.encode() + np.dstack([mantissa, exponent]).tobytes())
    return (mantissa * 2.0 ** (exponent[..., None].astype(float) - 136)).astype(np.float32)
