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
    try:
        content = json.loads((folder / NAME).read_text("utf-8"))
        # As JSON has them: lists for tuples.
        asked = json.loads(json_text({"schema": SCHEMA, "request": request, "inputs": inputs}))
        if {key: content.get(key) for key in asked} != asked:
            return False
        return all(digest(folder / name) == written for name, written in content["files"].items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return False


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file() and path.name != NAME)
