"""Materials for other programs, one module a target."""

from __future__ import annotations

from matest.export import merl

# Writer of each target by its name, which `--to` takes.
TARGETS = {
    "merl": merl,
}

__all__ = ["TARGETS"]
