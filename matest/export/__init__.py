"""Materials for other programs, one module a target."""

from __future__ import annotations

from matest.export import gltf, materialx, merl, mitsuba

# Writer of each target by its name, which `--to` takes.
TARGETS = {
    "mitsuba": mitsuba,
    "materialx": materialx,
    "gltf": gltf,
    "merl": merl,
}

__all__ = ["TARGETS"]
