"""Execute every notebook and keep its outputs: `python notebooks/run.py`; with --check nothing is saved."""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).parent


def main(*, save: bool) -> None:
    """Run the notebooks in order; an error in a cell ends with a traceback."""
    for path in sorted(HERE.glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(HERE)}}).execute()
        for cell in notebook.cells:
            cell.metadata.pop("execution", None)
        if save:
            nbformat.write(notebook, path)
        print(f"{path.name} runs")


if __name__ == "__main__":
    main(save="--check" not in sys.argv)
