"""The tables of a capture as the text of a capture.toml."""

from __future__ import annotations

import re
from typing import Any

import msgspec
import tomli_w


def as_toml(content: dict[str, Any]) -> str:
    """TOML with every list of numbers on one line."""
    text = tomli_w.dumps(content)
    return re.sub(r"\[\n((?:\s+[-+.\w]+,\n)+)\s*\]", lambda m: f"[{' '.join(m[1].split()).rstrip(',')}]", text)


def changes(table: msgspec.Struct) -> dict[str, Any]:
    """The keys of a table that differ from their defaults, as plain values."""
    defaults = {
        f.name: f.default if f.default_factory is msgspec.NODEFAULT else f.default_factory()
        for f in msgspec.structs.fields(table)
    }
    plain = msgspec.to_builtins(table)
    return {
        key: [changes(entry) for entry in getattr(table, key)] if key == "lights" else value
        for key, value in plain.items()
        if value is not None and value != defaults[key]
    }
