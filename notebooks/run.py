"""Execute notebooks and keep their outputs: `python notebooks/run.py [NUMBER...]`; with --check nothing is saved."""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).parent


def main(numbers: list[str], *, save: bool) -> None:
    """Run the notebooks whose names begin with one of the numbers, or all; an error in a cell ends with a traceback."""
    for path in sorted(HERE.glob("*.ipynb")):
        if numbers and path.name[:2] not in numbers:
            continue
        notebook = nbformat.read(path, as_version=4)
        before = _seconds()
        NotebookClient(
            notebook, timeout=600, coalesce_streams=True, resources={"metadata": {"path": str(HERE)}}
        ).execute()
        for cell in notebook.cells:
            cell.metadata.pop("execution", None)
        if save:
            nbformat.write(notebook, path)
        print(f"{path.name} runs, {_seconds() - before:.0f} CPU seconds", flush=True)


def _seconds() -> float:
    """CPU seconds of all kernels that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    options = sys.argv[1:]
    main([word for word in options if word != "--check"], save="--check" not in options)
