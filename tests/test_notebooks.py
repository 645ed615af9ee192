"""The notebooks that ship: executed, small, linked. CI executes them again."""

from __future__ import annotations

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def test_notebooks_are_numbered_from_one() -> None:
    assert [path.name[:2] for path in NOTEBOOKS] == [f"{number:02d}" for number in range(1, len(NOTEBOOKS) + 1)]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_executed_ends_with_evidence_and_is_linked(path: Path) -> None:
    code = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    outputs = [output.output_type for cell in code for output in cell.outputs]
    assert not {"error"} & set(outputs)
    assert code[-1].outputs
    assert path.stat().st_size < 310_000
    assert f"notebooks/{path.name}" in (ROOT / "README.md").read_text("utf-8")
