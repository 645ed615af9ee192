"""Reports in a real browser: Debian's Chromium, with WebGL2 in software."""

from __future__ import annotations

import base64
import math
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
import torch

from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar, model
from matest.capture import Capture, load_capture
from matest.estimation.photographs import PhotographFit
from matest.estimation.result import Estimate
from matest.inference.quantities import ParameterEstimate
from matest.photographs.images import write_image
from matest.photographs.photometry import srgb
from matest.report.folder import write_result
from matest.report.previews import LARGE_SIDE
from matest.report.raster import Raster, Window
from matest.report.relight import EXPOSURE, Relighting, relighting
from matest.simulate import simulate
from tests import scenes
from tests.captures import changed
from tests.environments import studio_map
from tests.estimates import clay
from tests.mapped import mapped, photographs
from tests.simulated import Studio, coloured
from tests.tolerances import RELIT_GLOSSY, RELIT_MATTE

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CHROMIUM = shutil.which("chromium")
if CHROMIUM is None:
    pytest.skip("Debian's chromium is not installed", allow_module_level=True)
playwright = pytest.importorskip("playwright.sync_api")

# WebGL2 without a graphics card.
OPTIONS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
EVIL = "<script>document.title='run'</script>.exr"
MATERIALS: dict[str, tuple[Brdf, float]] = {
    "matte": (OrenNayar([0.7, 0.6, 0.5], 0.5), RELIT_MATTE),
    "glossy": (CookTorrance([0.5, 0.2, 0.1], 1.0, 0.1, 0.04), RELIT_GLOSSY),
    "metal": (
        CookTorrance(0.0, 1.0, slope=0.2, eta=[0.2, 0.8, 1.3], k=[3.5, 2.6, 2.3], fresnel="conductor"),
        RELIT_GLOSSY,
    ),
}


@dataclass
class Opened:
    """A report in a browser.

    Attributes:
        page: of the browser.
        capture: the photographs.
        relit: what the relighting shows.
        tolerance: of its pixels, codes.
        complaints: errors of scripts, and what was asked from the network.
        size: of the file in bytes.
    """

    page: Page
    capture: Capture
    relit: Relighting
    tolerance: float
    complaints: list[str]
    size: int


def made_up(material: Brdf, capture: Capture) -> Estimate:
    """An estimate of the right material, whose last photograph is said to fit worst."""
    parameters = {
        name: ParameterEstimate(value.tolist(), None, None, declared.unit, "fixed", declared.doc)
        for (name, value), declared in zip(material.parameters.items(), material.declared.values(), strict=True)
    }
    images = [
        PhotographFit(name, 0.01 * (1 + number), None, None, 1.0 + number, None)
        for number, name in enumerate(capture.names)
    ]
    return clay(model=material.expression, material=material, parameters=parameters, images=images, holdout=None)


def in_a_room(folder: Path, materials: dict[str, Brdf]) -> Path:
    """A scene of small spheres side by side in a room."""
    write_image(folder / "room.exr", studio_map(16).float().numpy())
    objects = [
        f'[[object]]\nname = "{name}"\nshape = "sphere"\nposition = [{2 * number}, 0, 0]\nradius = 0.5\n'
        + scenes.material(brdf.expression, **{key: float(value) for key, value in brdf.parameters.items()}).replace(
            "[material]", "[object.material]"
        )
        for number, (name, brdf) in enumerate(materials.items())
    ]
    camera = '[camera]\nheight = 4\nresolution = [150, 100]\n[[image]]\nlights = [ { environment = "room.exr" } ]'
    return scenes.write(folder, *objects, camera)


def subject(kind: str) -> tuple[Estimate, Capture, float]:
    """An estimate, its capture, and the tolerance of relit pixels."""
    if kind == "mapped":
        return mapped(), photographs(), RELIT_MATTE
    material, tolerance = MATERIALS[kind]
    capture = Studio(size=80, lights=coloured()).photograph(material, seed=1)
    capture = changed(capture, names=(EVIL, *capture.names[1:]))
    return made_up(material, capture), capture, tolerance


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield browser
        browser.close()


def in_browser(browser: Browser, subject: tuple[Estimate, Capture, float], folder: Path) -> Opened:
    """Write the report of a subject and open it."""
    estimate, capture, tolerance = subject
    write_result(estimate, capture, folder)
    file = folder / "report.html"
    page, complaints = browser.new_context(viewport={"width": 1100, "height": 900}).new_page(), []
    page.on("console", lambda message: complaints.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda one: complaints.append(f"asked: {one.url}"))
    page.goto(file.as_uri())
    page.wait_for_selector("#relight[data-ready]")
    page.wait_for_selector("#viewer[data-shown]")
    surface, window = capture.scene.surface, Window.of(capture.scene.surface)
    raster = Raster.of(surface, -(-max(window.shape) // LARGE_SIDE), window)
    relit = relighting(estimate, capture.scene, raster)
    assert isinstance(relit, Relighting)
    return Opened(page, capture, relit, tolerance, complaints, file.stat().st_size)


@pytest.fixture(scope="module", params=["matte", "glossy", "metal", "mapped"])
def opened(request: pytest.FixtureRequest, browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The report of each material."""
    one = in_browser(browser, subject(request.param), tmp_path_factory.mktemp("report") / request.param)
    yield one
    one.page.context.close()


def canvas_pixels(page: Page) -> np.ndarray:
    """What the relit canvas shows [H, W, 4], RGB and opacity."""
    uri = page.evaluate("document.querySelector('#relight canvas').toDataURL()")
    stored = np.frombuffer(base64.b64decode(uri.partition(",")[2]), dtype=np.uint8)
    return cv2.cvtColor(cv2.imdecode(stored, cv2.IMREAD_UNCHANGED), cv2.COLOR_BGRA2RGBA)


def difference(one: Opened, light: torch.Tensor, changes: dict[str, torch.Tensor] | None = None) -> int:
    """Codes by which the canvas is off the model at most."""
    shown = canvas_pixels(one.page).reshape(-1, 4)
    assert (shown[:, 3] > 0).sum() == len(one.relit.pixels)
    colours = shown[one.relit.pixels, :3].astype(int)
    assert colours.max() > 150
    radiance = one.relit.radiance(light, changes).expand(-1, 3).numpy()
    return int(np.abs(colours - srgb(radiance * EXPOSURE / one.relit.white)).max())


def test_nothing_goes_wrong_and_nothing_is_asked_of_the_network(opened: Opened) -> None:
    within = r"asked: (file:.*/report\.html$|data:|blob:)"
    assert [text for text in opened.complaints if not re.match(within, text)] == []


def test_the_file_is_small(opened: Opened) -> None:
    assert opened.size < 380_000


def test_relit_pixels_are_those_of_the_model(opened: Opened) -> None:
    for number in (0, 3):
        opened.page.select_option("#relight select", str(number))
        assert difference(opened, opened.relit.lights[number]) <= opened.tolerance


def test_maps_of_albedo_and_roughness_are_relit_pixel_by_pixel(browser: Browser, tmp_path: Path) -> None:
    studio = Studio(size=64, lights=coloured())
    across = torch.linspace(0, 1, len(studio.scene.surface), dtype=torch.float64)[:, None]
    material = OrenNayar(0.3 + 0.4 * across, 0.2 + 0.4 * across)
    estimate = replace(made_up(OrenNayar(0.5, 0.4), studio.photograph(material)), material=material)
    one = in_browser(browser, (estimate, studio.photograph(material), RELIT_MATTE), tmp_path / "report")
    assert difference(one, one.relit.lights[0]) <= RELIT_MATTE
    one.page.context.close()


def dragged(page: Page, across: float, down: float) -> torch.Tensor:
    """Drag the light to a place of the canvas, in shares of its size; returns the direction that is meant [3]."""
    canvas = page.locator("#relight canvas")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    x, y = round(box["x"] + across * box["width"]), round(box["y"] + down * box["height"])
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    page.mouse.down()
    page.mouse.move(x, y)
    page.mouse.up()
    right, up = 2 * (x - box["x"]) / box["width"] - 1, 1 - 2 * (y - box["y"]) / box["height"]
    # The rim of a sphere is at 90°.
    polar = math.hypot(right, up) * math.pi / 2
    part = math.sin(polar) / math.hypot(right, up)
    return torch.tensor([part * right, part * up, math.cos(polar)], dtype=torch.float64)


def test_the_light_follows_the_pointer(opened: Opened) -> None:
    light = dragged(opened.page, 0.3, 0.35)
    assert difference(opened, light) <= opened.tolerance


def test_one_of_several_objects_in_a_room_is_shown_alone_in_a_light_from_before_it(
    browser: Browser, tmp_path: Path
) -> None:
    materials = {"ball": OrenNayar(0.6, 0.4), "other": Lambert(0.3)}
    capture = load_capture(simulate(in_a_room(tmp_path, materials))).objects["ball"]
    one = in_browser(browser, (made_up(materials["ball"], capture), capture, RELIT_MATTE), tmp_path / "report")
    assert [text for text in one.complaints if not text.startswith("asked: file:")] == []
    assert max(one.relit.shape) < 0.4 * max(capture.scene.surface.shape)
    assert float(one.relit.lights[0][2]) > 0.3
    assert difference(one, one.relit.lights[0]) <= RELIT_MATTE
    photo = one.page.evaluate("document.querySelector('#viewer .photo').naturalHeight")
    assert photo == one.relit.shape[0]
    one.page.context.close()


def test_light_that_is_scattered_forward_goes_to_the_right_side(browser: Browser, tmp_path: Path) -> None:
    material = model("li-torrance(forward=on)")[0].replace({"k_fs": 5.0})
    capture = Studio(size=64, lights=coloured()[:2]).photograph(material)
    one = in_browser(browser, (made_up(material, capture), capture, RELIT_GLOSSY), tmp_path / "report")
    light = dragged(one.page, 0.06, 0.2)
    assert light[2] < -0.03
    assert difference(one, light) <= RELIT_GLOSSY
    one.page.context.close()


def test_the_light_follows_arrow_keys(opened: Opened) -> None:
    canvas, reading = opened.page.locator("#relight canvas"), opened.page.locator("#relight .reading")
    before = reading.text_content()
    canvas.focus()
    for _ in range(3):
        canvas.press("ArrowRight")
    assert reading.text_content() != before
    assert opened.page.locator("#relight select").input_value() == ""


def test_sliders_move_parameters(opened: Opened) -> None:
    opened.page.locator("#relight form > button").click()
    name, declared = next(
        (name, declared) for name, declared in opened.relit.material.declared.items() if name in ("sigma", "slope")
    )
    slider = opened.page.locator(f'#relight input[aria-label="{name}"]')
    slider.focus()
    for _ in range(3):
        slider.press("PageUp")
    value = float(slider.input_value())
    value = math.exp(value) if declared.log else value
    changes = {name: torch.tensor([value], dtype=torch.float64)}
    assert value > 1.05 * float(opened.relit.baked.spans[name].value)
    assert difference(opened, opened.relit.lights[0], changes) <= opened.tolerance


def test_the_worst_photograph_is_shown_first_and_others_by_key(opened: Opened) -> None:
    page = opened.page
    rows = page.locator("tr[data-image]")
    first = rows.first.get_attribute("data-image")
    page.locator("tr[data-image] button").first.click()
    page.wait_for_selector(f'#viewer[data-shown="{first}"]')
    page.locator("tr[data-image] button").first.press("ArrowDown")
    second = rows.nth(1).get_attribute("data-image")
    page.wait_for_selector(f'#viewer[data-shown="{second}"]')
    assert page.locator("#viewer .name").text_content() == opened.capture.names[int(second)]


def test_tab_reaches_one_row_of_the_table(opened: Opened) -> None:
    buttons = opened.page.locator("tr[data-image] button")
    buttons.first.focus()
    buttons.first.press("ArrowDown")
    places = opened.page.evaluate("[...document.querySelectorAll('tr[data-image] button')].map(one => one.tabIndex)")
    assert places == [-1, 0, *[-1] * (len(opened.capture) - 2)]


def test_sliders_say_their_value_in_words(opened: Opened) -> None:
    for slider in opened.page.locator("#relight input[type=range]").all():
        shown = slider.locator("xpath=preceding-sibling::output").text_content()
        assert slider.get_attribute("aria-valuetext") == shown


def test_a_head_sorts_by_its_column(opened: Opened) -> None:
    heads = opened.page.locator("table.sortable th")
    for order in ("descending", "ascending"):
        heads.nth(1).locator("button").press("Enter")
        assert heads.nth(1).get_attribute("aria-sort") == order
        keys = opened.page.eval_on_selector_all(
            "tr[data-image]", "rows => rows.map(row => Number(row.cells[1].dataset.key))"
        )
        assert keys == sorted(keys, reverse=order == "descending")


def profile(page: Page, name: str) -> np.ndarray:
    """Heights of a curve of the profile as shares of the largest of both curves."""
    path = page.locator(f"svg.profile path.{name}").get_attribute("d")
    heights = np.array([float(y) for y in re.findall(r" ([\d.]+)", path)])
    return (192 - heights) / 184


def handle_place(page: Page, end: str) -> tuple[float, float]:
    """Where an end of the line is, in shares of the picture."""
    style = page.locator(f"#viewer .handle.{end}").get_attribute("style")
    across, down = re.findall(r"([\d.]+)%", style)
    return float(across) / 100, float(down) / 100


def test_the_line_crosses_an_object_that_is_off_the_middle(browser: Browser, tmp_path: Path) -> None:
    material, place = OrenNayar(0.7, 0.5), "centre = [47, 48]\nradius = 15"
    corner = scenes.sphere(64).replace("centre = [32.0, 32.0]\nradius = 28.8", place)
    assert place in corner
    values = scenes.material("oren-nayar", albedo=[0.7, 0.7, 0.7], sigma=0.5)
    scene = scenes.write(tmp_path / "scene", values, corner, scenes.distant(scenes.LIGHTS[:3]))
    capture = load_capture(simulate(scene))
    one = in_browser(browser, (made_up(material, capture), capture, RELIT_MATTE), tmp_path / "report")
    start, end = handle_place(one.page, "from"), handle_place(one.page, "to")
    assert start[1] == end[1]
    assert 34 < 64 * start[1] < 62
    assert 20 < 64 * start[0] < 47 < 64 * end[0] <= 64
    assert profile(one.page, "modelled").max() > 0.5
    one.page.context.close()


def test_the_profile_follows_the_drag(opened: Opened) -> None:
    page, capture = opened.page, opened.capture
    page.locator("tr[data-image='1'] button").click()
    page.wait_for_selector("#viewer[data-shown='1']")
    before = profile(page, "measured")
    pad = page.locator("#viewer .compare .pad")
    pad.scroll_into_view_if_needed()
    box = pad.bounding_box()
    start = handle_place(page, "from")
    handle = page.locator("#viewer .handle.to").bounding_box()
    page.mouse.move(handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2)
    page.mouse.down()
    end = 0.7, 0.2
    page.mouse.move(box["x"] + end[0] * box["width"], box["y"] + end[1] * box["height"])
    page.mouse.up()
    measured = profile(page, "measured")
    assert len(measured) != len(before) or np.abs(measured - before).max() > 0.05
    surface = capture.scene.surface
    image = surface.image(capture.radiance(1).mean(axis=1))
    share = np.linspace(0, 1, len(measured))
    x, y = (one + share * (other - one) for one, other in zip(start, end, strict=True))
    side = surface.shape[0]
    truth = image[(y * side).astype(int), (x * side).astype(int)]
    assert len(measured) > 20
    # A place may fall on the pixel beside by the pointer's rounding: most do not.
    assert np.median(np.abs(measured / measured.max() - truth.clip(0) / truth.max())) < 0.01


def test_the_split_between_photograph_and_model_moves_by_key(opened: Opened) -> None:
    split = opened.page.locator("#viewer input.split")
    split.focus()
    split.press("Home")
    clip = opened.page.locator("#viewer .photo").evaluate("photo => getComputedStyle(photo).clipPath")
    assert clip == "inset(0px 100% 0px 0px)"


def test_residuals_are_coloured_in_units_of_the_noise(opened: Opened) -> None:
    scale = opened.page.locator("#viewer input.range")
    scale.focus()
    mean = "e => { const d = e.getContext('2d').getImageData(0, 0, e.width, e.height).data; let s = 0;" \
           " for (let i = 0; i < d.length; i += 4) s += Math.abs(d[i] - d[i + 2]); return s; }"  # fmt: skip
    canvas = opened.page.locator("#viewer canvas.residual")
    scale.press("Home")
    strong = canvas.evaluate(mean)
    assert "full colour at 1 σ" in opened.page.locator("#viewer output.range").text_content()
    scale.press("End")
    assert canvas.evaluate(mean) < 0.1 * strong


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone_shows_it_without_scrolling_sideways(opened: Opened, scheme: str) -> None:
    opened.page.emulate_media(color_scheme=scheme)
    opened.page.set_viewport_size({"width": 390, "height": 844})
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= 390
    ground = opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (int(re.findall(r"\d+", ground)[0]) < 128) == (scheme == "dark")
    opened.page.set_viewport_size({"width": 1100, "height": 900})


def test_a_name_that_is_a_script_is_shown_and_not_run(opened: Opened) -> None:
    if opened.capture.names[0] != EVIL:
        pytest.skip("its files have other names")
    assert opened.page.title().startswith("matest")
    assert opened.page.locator("tr[data-image='0'] button").text_content() == EVIL
