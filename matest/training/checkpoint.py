"""Checkpoints of training: nested state in one safetensors file, written whole or not at all, read without pickle."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from matest.errors import InputError

_SCHEMA = "matest.checkpoint/1"


def write_checkpoint(path: Path, state: Mapping[str, Any]) -> None:
    """Write `state`, replacing an earlier file only once the new one is complete.

    Args:
        path: the file; its folder must exist.
        state: any nesting of dicts, lists and tuples of tensors, numbers, truth values, strings and None. Dense tensors
            are stored under their path in it (`material/values.0`), the rest as JSON in the file's metadata.

    Raises:
        InputError: the state holds something else.
    """
    tensors: dict[str, Tensor] = {}
    outline = json.dumps(_flatten(state, "", tensors))
    content = save(tensors, {"schema": _SCHEMA, "state": outline})
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            # The content must be on the disk before the name is: a power cut would leave an empty checkpoint.
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def read_checkpoint(path: Path) -> dict[str, Any]:
    """The state that `write_checkpoint` wrote, tensors on the CPU.

    Raises:
        InputError: the file is no checkpoint, or damaged.
    """
    try:
        if not path.is_file():
            raise ValueError("it is no regular file")
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            if metadata["schema"] != _SCHEMA:
                raise ValueError(f"its schema is {metadata['schema']}, not {_SCHEMA}")
            state = _unflatten(json.loads(metadata["state"]), file.get_tensor)
        return dict(state)
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        raise unusable(path, error) from None


def unusable(path: Path, error: Exception) -> InputError:
    """The refusal of a checkpoint that cannot be read or restored because of `error`."""
    reason = f"no {error}" if isinstance(error, KeyError) else " ".join(str(error).split()).rstrip(".")
    return InputError(
        f"{path}: expected a checkpoint of fit_gradient; got a file that is none, or is damaged ({reason}). Delete it "
        "to start anew, or name another file."
    )


def _flatten(value: Any, place: str, tensors: dict[str, Tensor]) -> Any:
    """`value` as JSON, its tensors moved into `tensors`."""
    if isinstance(value, Tensor):
        # The keys 0 and "0" give the same path.
        name = place if place not in tensors else f"{place} ({len(tensors)})"
        tensors[name] = value.detach().cpu().clone(memory_format=torch.contiguous_format)
        return {"tensor": name}
    if isinstance(value, Mapping):
        return {"dict": [[key, _flatten(part, _below(place, key), tensors)] for key, part in value.items()]}
    if isinstance(value, list | tuple):
        parts = [_flatten(part, _below(place, number), tensors) for number, part in enumerate(value)]
        return {"tuple" if isinstance(value, tuple) else "list": parts}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise InputError(
        f"a checkpoint holds tensors, numbers, strings and nestings of them; got a {type(value).__name__} at {place}. "
        "Register state of a module as buffers."
    )


def _below(place: str, key: object) -> str:
    return f"{place}/{key}" if place else str(key)


def _unflatten(outline: Any, tensor: Any) -> Any:
    """The inverse of `_flatten`; `tensor` gives a tensor by its name."""
    if not isinstance(outline, dict):
        return outline
    ((kind, content),) = outline.items()
    if kind == "tensor":
        # Copied to aligned memory: sums over a tensor that is aligned as in the file round differently.
        return tensor(content).clone()
    if kind == "dict":
        return {key: _unflatten(part, tensor) for key, part in content}
    parts = [_unflatten(part, tensor) for part in content]
    return {"list": parts, "tuple": tuple(parts)}[kind]
