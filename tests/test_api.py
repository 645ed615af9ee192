"""The Python interface as the documentation prints it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import torch

import matest

ROOT = Path(__file__).parents[1]
VASE = ROOT / "renders" / "vase"


def test_every_public_name_can_be_imported() -> None:
    for name in matest.__all__:
        assert getattr(matest, name) is not None
    assert set(matest.__all__) <= set(dir(matest))
    with pytest.raises(AttributeError, match="no attribute 'estimat'"):
        matest.estimat  # noqa: B018


def test_the_names_survive_importing_the_modules() -> None:
    import matest.cli
    import matest.estimation.estimate

    assert callable(matest.estimate)
    assert callable(matest.render)
    assert callable(matest.predict)


def test_captures_and_estimates_print_in_a_line() -> None:
    capture = matest.load_capture(VASE)
    assert (
        repr(capture) == f"Capture(vase: 3 photographs, {len(capture.scene.surface)} pixels of the object, 3 channels)"
    )
    text = repr(matest.estimate(capture, model="oren-nayar", fix={"sigma": 0.7}))
    assert text.startswith("Estimate(vase: oren-nayar, albedo=[0.7")
    assert len(text) < 400


def test_samples_are_no_capture() -> None:
    samples = matest.load_capture(VASE).samples()
    with pytest.raises(TypeError, match=r"fit .* and judge"):
        matest.estimate(samples)


def test_the_documented_session_and_training_loop_work() -> None:
    capture = matest.load_capture(VASE)
    estimate = matest.estimate(capture, model="oren-nayar")
    sigma = estimate.parameters["sigma"]
    assert sigma.std is not None
    assert sigma.interval95[0] < sigma.value < sigma.interval95[1]
    image = matest.render(capture.scene, estimate.material)
    assert image.shape == (3, 256, 192, 3)

    samples = capture.samples()
    material = matest.Trainable(matest.brdf.OrenNayar(albedo=0.5, sigma=0.3))
    optimiser = torch.optim.Adam(material.parameters(), lr=0.05)
    losses = []
    for _ in range(60):
        for batch in samples.batches(65_536, shuffle=True, seed=0):
            loss = matest.losses.photometric(matest.shade(material(), batch.points), batch.radiance)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(loss.item())
    assert losses[-1] < losses[0] / 10


def test_the_examples_of_the_documents_run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    blocks = [
        (page.name, block)
        for page in pages
        for block in re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.DOTALL)
    ]
    assert {name for name, _ in blocks} >= {"README.md", "maps.md", "python.md"}
    monkeypatch.chdir(ROOT)
    variables: dict[str, Any] = {}
    for page, block in blocks:
        names: dict[str, Any] = {}
        exec(compile(block, page, "exec"), names)
        variables |= names
    assert "0.69" in capsys.readouterr().out
    assert variables["fit"].losses[-1] < variables["fit"].losses[0] / 10
    assert 0 < variables["dissimilarity"] < 1
    # The vase has one albedo, 0.7: the prior takes the noise of its map away.
    spread = [(values - 0.7).square().mean().sqrt() for values in (variables["start"].albedo, variables["smooth"])]
    assert spread[1] < 0.7 * spread[0]
    assert all(value.grad.abs().max() > 0 for value in variables["material"].parameters())
    truth = torch.tensor([0.25, 0.3, 0.92])
    refined = torch.nn.functional.normalize(variables["guess"].detach(), dim=0)
    torch.testing.assert_close(refined, truth / truth.norm(), rtol=0, atol=2e-3)


def test_a_rendered_image_is_differentiable_in_the_material() -> None:
    capture = matest.load_capture(VASE)
    sigma = torch.tensor(0.5, requires_grad=True)
    image = matest.render(capture.scene, matest.brdf.OrenNayar(albedo=0.7, sigma=sigma))
    image.mean().backward()
    assert torch.isfinite(sigma.grad)
    assert sigma.grad != 0


def test_the_material_of_a_result_folder_shades_like_the_estimate(tmp_path: Path) -> None:
    from matest.report.folder import write_result

    capture = matest.load_capture(VASE)
    estimate = matest.estimate(capture, model="oren-nayar")
    write_result(estimate, capture, tmp_path / "result")
    again = matest.load_material(tmp_path / "result")
    torch.testing.assert_close(matest.render(capture.scene, again), matest.render(capture.scene, estimate.material))
