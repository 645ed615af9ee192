"""The manifest of a result: what was asked for, of which files, and the digests of what came out."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matest.capture.digests import digest
from matest.outputs import json_text, write_text

# The file of a result folder.
NAME = "manifest.json"
SCHEMA = "matest.manifest/1"


def write(folder: Path, request: Mapping[str, Any], inputs: Mapping[str, str]) -> None:
    """Write the manifest of the files that are in a folder.

    Args:
        folder: of a result.
        request: what decides on the result beside the inputs, of plain types: version and options.
        inputs: digest of every file of the capture, by its path from the capture's folder.
    """
    files = {path.relative_to(folder).as_posix(): digest(path) for path in _files(folder)}
    content = {"schema": SCHEMA, "request": request, "inputs": inputs, "files": files}
    write_text(folder / NAME, json_text(content, indent=1, ensure_ascii=False) + "\n")


def answers(folder: Path, request: Mapping[str, Any], inputs: Mapping[str, str]) -> bool:
    """Whether a folder holds the complete result of a request of these inputs, every file as it was written."""
    # As JSON has them: lists for tuples.
    asked = json.loads(json_text({"schema": SCHEMA, "request": request, "inputs": inputs}))
    content = _read(folder)
    return {key: content.get(key) for key in asked} == asked and is_whole(folder)


def is_whole(folder: Path) -> bool:
    """Whether a folder holds a result with every file as it was written."""
    files = _read(folder).get("files") or {}
    try:
        return bool(files) and all(digest(folder / name) == written for name, written in files.items())
    except (OSError, TypeError, AttributeError):
        return False


def inputs_of(folder: Path) -> dict[str, str]:
    """Digests of the files that a result is of, by their path from the capture's folder; none of what is no result."""
    return _read(folder).get("inputs", {})


def _read(folder: Path) -> dict[str, Any]:
    """The content of a manifest; empty where there is none that can be read."""
    try:
        content = json.loads((folder / NAME).read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) and content.get("schema") == SCHEMA else {}


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file() and path.name != NAME)
