"""Ways of damaging a file: bytes, numbers of headers, words of texts, values of JSON and TOML."""

from __future__ import annotations

import json
import re
import struct
import tomllib
import zlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

# From a file's content another one.
Damage = Callable[[bytes, np.random.Generator], bytes]

# Bytes at the beginning of a file, where most of what can go wrong is said.
_HEAD = 128
# Longest stretch that is repeated, removed or blanked.
_STRETCH = 64
# Most bits that are flipped.
_FLIPS = 8
# Integers at which programs go wrong, by their bits.
_EDGES = {
    bits: (0, 1, 2, 3, 7, 16, 255, 2 ** (bits - 1) - 1, 2 ** (bits - 1), 2**bits - 2, 2**bits - 1)
    for bits in (8, 16, 32, 64)
}
# Floats likewise.
_FLOATS = (0.0, -0.0, -1.0, 1e-300, 5e-324, 1e30, -1e38, 1e300, float("nan"), float("inf"), float("-inf"))
# Words likewise.
_WORDS = (
    "0", "-0", "-1", "1", "1e-320", "1e38", "1e308", "1e999", "-1e999", "nan", "-nan", "inf", "NaN", "Infinity", "1,5",
    "0x10", "1_000", "1e", "--1", "9" * 25, "9" * 5000, "4294967296", "-2147483649", "", " ", "\0", "\t", "'", '"',
    "\"\"\"", "#", "\\", "\\u0000", "../../etc/passwd", "/dev/zero", "C:\\a", "<script>", "[bold]", "\x1b[2J", "é", "٣",
    "\u202e", "\ufeff", "[" * 3000, "{" * 3000, "a." * 3000, "true", "null", "None",
)  # fmt: skip
# Values likewise, for places of JSON and TOML where another stood.
_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1, 2**31, 2**63, -(2**63) - 1, 10**400, 1e-320, 1e38, 1e308, float("nan"), float("inf"), "",
    "nan", "0", "a\0b", "<script>", "../x", "/dev/zero", "x" * 5000, [], {}, [[]], [[[1.0]]], [None], [1e308] * 4,
    [float("nan")] * 3, {"x": 1}, {"": {}}, [0, 0, 0], [1, 2], ["a"],
)  # fmt: skip
_WORD = re.compile(rb"[^\s,;=:\[\]{}()]+")


def flipped(data: bytes, rng: np.random.Generator) -> bytes:
    """Some bits are others; an empty file has a byte."""
    changed = bytearray(data or b"\0")
    for place in _places(data, rng, int(rng.integers(1, _FLIPS + 1))):
        changed[place] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def truncated(data: bytes, rng: np.random.Generator) -> bytes:
    """The end is missing, or something follows it."""
    if rng.random() < 0.2:
        return data + rng.bytes(int(rng.integers(1, _STRETCH)))
    return data[: int(rng.integers(len(data) + 1))]


def renumbered(data: bytes, rng: np.random.Generator) -> bytes:
    """A number of some width and byte order is one at which programs go wrong."""
    place, order = _places(data, rng, 1)[0], "<>"[int(rng.integers(2))]
    bits = (8, 16, 32, 64)[int(rng.integers(4))]
    if bits >= 32 and rng.random() < 0.3:
        value = _FLOATS[int(rng.integers(len(_FLOATS)))]
        with np.errstate(over="ignore"):
            number = np.array(value, dtype=f"{order}f{bits // 8}").tobytes()
    else:
        edge = _EDGES[bits][int(rng.integers(len(_EDGES[bits])))]
        number = struct.pack(order + {8: "B", 16: "H", 32: "I", 64: "Q"}[bits], edge)
    return data[:place] + number + data[place + len(number) :]


def rearranged(data: bytes, rng: np.random.Generator) -> bytes:
    """A stretch is missing, there twice, blank, or somewhere else."""
    begin, target = _places(data, rng, 2)
    end = begin + int(rng.integers(1, _STRETCH))
    stretch = data[begin:end]
    kind = int(rng.integers(4))
    if kind == 0:
        return data[:begin] + data[end:]
    if kind == 1:
        return data[:begin] + stretch + data[begin:]
    if kind == 2:
        return data[:begin] + bytes(len(stretch)) + data[end:]
    return data[:target] + stretch + data[target + len(stretch) :]


def reworded(data: bytes, rng: np.random.Generator) -> bytes:
    """A word of a text is another, one of its own or one at which programs go wrong."""
    words = [match.span() for match in _WORD.finditer(data)]
    if not words:
        return data + b"0"
    begin, end = words[int(rng.integers(len(words)))]
    if rng.random() < 0.25:
        other = slice(*words[int(rng.integers(len(words)))])
        return data[:begin] + data[other] + data[end:]
    word = _WORDS[int(rng.integers(len(_WORDS)))]
    return data[:begin] + word.encode("utf-8" if rng.random() < 0.9 else "utf-16") + data[end:]


def relined(data: bytes, rng: np.random.Generator) -> bytes:
    """A line of a text is missing, there twice, or at another place."""
    lines = data.split(b"\n")
    place, target = (int(place) for place in rng.integers(len(lines), size=2))
    line = lines.pop(place) if rng.random() < 0.7 else lines[place]
    if rng.random() < 0.7:
        lines.insert(target, line)
    return b"\n".join(lines)


def revalued_json(data: bytes, rng: np.random.Generator) -> bytes:
    """A value of JSON is another, which may be NaN; a key is missing or has another name."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return data
    return json.dumps(_revalued(content, rng), ensure_ascii=bool(rng.integers(2))).encode("utf-8", "replace")


def revalued_toml(data: bytes, rng: np.random.Generator) -> bytes:
    """The same for TOML."""
    import tomli_w

    try:
        return tomli_w.dumps(_revalued(tomllib.loads(data.decode()), rng)).encode("utf-8", "replace")
    # TOML has no null, and a value in place of the whole is none.
    except (ValueError, TypeError, AttributeError, RecursionError):
        return data


def with_checksums(data: bytes) -> bytes:
    """A PNG whose chunks have the checksums of what is in them, so that more than these is looked at."""
    place, whole = 8, bytearray(data)
    while place + 12 <= len(data):
        end = place + 8 + int.from_bytes(data[place : place + 4], "big")
        if end + 4 > len(data):
            break
        whole[end : end + 4] = struct.pack(">I", zlib.crc32(data[place + 4 : end]))
        place = end + 4
    return bytes(whole)


def with_lengths(data: bytes) -> bytes:
    """A GLB whose header and first chunk have the lengths that their text has, when it was changed."""
    end = data.find(b"BIN\0") - 4
    text = data[20 : end if end > 20 else len(data)].rstrip() + b" "
    text += b" " * (-len(text) % 4)
    rest = data[end:] if end > 20 else b""
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + rest


def revalued_glb(data: bytes, rng: np.random.Generator) -> bytes:
    """A value in the JSON of a GLB is another."""
    end = data.find(b"BIN\0") - 4
    if end <= 20:
        return data
    return with_lengths(data[:20] + revalued_json(data[20:end], rng) + data[end:])


def checked(damage: Damage, mend: Callable[[bytes], bytes], data: bytes, rng: np.random.Generator) -> bytes:
    """Another damage, after which what would give it away at once is mended."""
    return mend(damage(data, rng))


OF_BYTES: tuple[Damage, ...] = (flipped, truncated, renumbered, rearranged)
OF_TEXT: tuple[Damage, ...] = (reworded, reworded, relined, flipped, truncated, rearranged)


def damaged(files: Sequence[bytes], damages: Sequence[Damage], rng: np.random.Generator) -> bytes:
    """One of some files after one to three damages, or the beginning of one with the end of another."""
    data = files[int(rng.integers(len(files)))]
    if rng.random() < 0.1:
        other = files[int(rng.integers(len(files)))]
        return data[: int(rng.integers(len(data) + 1))] + other[int(rng.integers(len(other) + 1)) :]
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        data = damages[int(rng.integers(len(damages)))](data, rng)
    return data


def _places(data: bytes, rng: np.random.Generator, count: int) -> list[int]:
    """Places of bytes, half of them at the beginning of the file; 0 in an empty one, to which bytes are appended."""
    length = min(len(data), _HEAD) if rng.random() < 0.5 else len(data)
    return [int(place) for place in rng.integers(length, size=count)] if length else [0] * count


def _revalued(content: Any, rng: np.random.Generator) -> Any:
    """The same with another value, name or length at one place."""
    if isinstance(content, dict) and content and rng.random() < 0.95:
        key = [*content][int(rng.integers(len(content)))]
        if rng.random() < 0.1:
            renamed = key[:-1] if rng.random() < 0.5 else _WORDS[int(rng.integers(len(_WORDS)))]
            return {renamed if name == key else name: value for name, value in content.items()}
        if rng.random() < 0.1:
            return {name: value for name, value in content.items() if name != key}
        return {name: _revalued(value, rng) if name == key else value for name, value in content.items()}
    if isinstance(content, list) and content and rng.random() < 0.9:
        place = int(rng.integers(len(content)))
        if rng.random() < 0.2:
            return content[:place] if rng.random() < 0.5 else [*content, content[place]]
        return [_revalued(value, rng) if number == place else value for number, value in enumerate(content)]
    return _VALUES[int(rng.integers(len(_VALUES)))]
