"""Checkpoints: what goes in comes out, and a file is whole or refused."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from matest.training.checkpoint import read_checkpoint, write_checkpoint
from tests.captures import refusal


def test_any_nesting_of_tensors_and_numbers_comes_back_as_it_was(tmp_path: Path) -> None:
    state = {
        "numbers": [1, 0.1, math.inf, True, None, "text"],
        "betas": (0.9, 0.999),
        0: {"0": [], "nested": [torch.arange(3), (torch.tensor(2.5, dtype=torch.float64), None)]},
    }
    write_checkpoint(tmp_path / "state.safetensors", state)
    again = read_checkpoint(tmp_path / "state.safetensors")
    integers, (scalar, nothing) = again[0].pop("nested")
    assert torch.equal(integers, torch.arange(3))
    assert scalar.dtype == torch.float64
    assert scalar.shape == ()
    assert scalar == 2.5
    assert nothing is None
    assert again == {**state, 0: {"0": []}}
    assert isinstance(again["betas"], tuple)


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16, torch.int64, torch.uint8, torch.bool])
def test_bits_of_every_dtype_are_kept(tmp_path: Path, dtype: torch.dtype) -> None:
    values = (torch.randn(4, 5, generator=torch.Generator().manual_seed(0)) * 10).abs().to(dtype)
    write_checkpoint(tmp_path / "state", {"transposed": values.T, "row": values[2], "whole": values})
    again = read_checkpoint(tmp_path / "state")
    for name, expected in {"transposed": values.T, "row": values[2], "whole": values}.items():
        assert again[name].dtype == dtype
        assert torch.equal(again[name], expected)


def test_not_a_number_and_empty_tensors_are_kept(tmp_path: Path) -> None:
    write_checkpoint(tmp_path / "state", {"nan": torch.tensor([math.nan, -0.0]), "empty": torch.zeros(0, 3)})
    again = read_checkpoint(tmp_path / "state")
    assert again["nan"].isnan().tolist() == [True, False]
    assert math.copysign(1, again["nan"][1].item()) == -1
    assert again["empty"].shape == (0, 3)


def test_paths_that_spell_the_same_are_told_apart(tmp_path: Path) -> None:
    write_checkpoint(tmp_path / "state", {0: torch.tensor(1.0), "0": torch.tensor(2.0)})
    assert read_checkpoint(tmp_path / "state") == {0: torch.tensor(1.0), "0": torch.tensor(2.0)}


def test_other_programs_find_tensors_under_their_path(tmp_path: Path) -> None:
    write_checkpoint(tmp_path / "state", {"material": {"values.0": torch.tensor([1.0, 2.0])}})
    with safe_open(tmp_path / "state", framework="pt") as file:
        assert file.get_tensor("material/values.0").tolist() == [1.0, 2.0]


def test_what_is_neither_tensor_nor_number_is_refused_and_leaves_the_file_alone(tmp_path: Path) -> None:
    write_checkpoint(tmp_path / "state", {"step": 1})
    message = refusal(lambda: write_checkpoint(tmp_path / "state", {"module": {"extra": [1, {2, 3}]}}))
    assert "got a set at module/extra/1" in message
    assert read_checkpoint(tmp_path / "state") == {"step": 1}


@pytest.mark.parametrize("moment", ["fsync", "replace"])
def test_an_interrupted_writing_keeps_the_last_complete_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    write_checkpoint(tmp_path / "state", {"step": 1})
    monkeypatch.setattr(os, moment, interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_checkpoint(tmp_path / "state", {"step": 2})
    monkeypatch.undo()
    assert read_checkpoint(tmp_path / "state") == {"step": 1}
    assert [file.name for file in tmp_path.iterdir()] == ["state"]


def test_a_file_cut_off_anywhere_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "run.safetensors"
    write_checkpoint(path, {"values": torch.arange(10.0), "step": 3})
    content = path.read_bytes()
    for length in (0, 5, 8, 60, len(content) - 1):
        path.write_bytes(content[:length])
        message = refusal(lambda: read_checkpoint(path))
        assert message.startswith(f"{path}: expected a checkpoint of fit_gradient")
        assert "Delete it to start anew" in message


def outline(state: object) -> dict[str, str]:
    return {"schema": "matest.checkpoint/1", "state": json.dumps(state)}


@pytest.mark.parametrize(
    ("metadata", "reason"),
    [
        (None, "no 'schema'"),
        ({"schema": "matest.checkpoint/9", "state": "{}"}, "its schema is matest.checkpoint/9"),
        ({"schema": "matest.checkpoint/1"}, "no 'state'"),
        ({"schema": "matest.checkpoint/1", "state": "{"}, "Expecting property name"),
        (outline({"dict": [["step", {"tensor": "gone"}]]}), "gone"),
        (outline({"dict": [["step", {"pickle": [1]}]]}), "no 'pickle'"),
        (outline({"dict": 5}), "not iterable"),
        (outline({"dict": [], "list": []}), "too many values"),
        (outline(7), "not iterable"),
    ],
)
def test_a_safetensors_file_of_something_else_is_refused(
    tmp_path: Path, metadata: dict[str, str] | None, reason: str
) -> None:
    save_file({"weights": torch.zeros(3)}, tmp_path / "model.safetensors", metadata)
    assert reason in refusal(lambda: read_checkpoint(tmp_path / "model.safetensors"))


def test_a_pickle_is_refused_unopened(tmp_path: Path) -> None:
    torch.save({"step": 1}, tmp_path / "run.pt")
    assert "run.pt: expected a checkpoint" in refusal(lambda: read_checkpoint(tmp_path / "run.pt"))
