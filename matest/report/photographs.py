"""What a report says of single photographs, and of residuals by angle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from matest.estimation.photographs import PhotographFit, Turn
from matest.estimation.residual_angles import AngularResiduals
from matest.report.curves import Curve, drawing, legend
from matest.report.format import chi2, share
from matest.report.html import escape, meter
from matest.report.plots import COLOURS

_COLUMNS = ("photograph", "relative rms error", "χ²")
_LIGHT_COLUMNS = ("level", "turn of its light")
_ODD_COLUMN = "times the usual"
_LEGEND = (
    "Level: the factor by which a photograph is brighter than the others say. Turn: by how much, and to where, its "
    "light would have to move to explain its residual best, if its level may be wrong too (-: no turn up to 20° does)."
)
_ODD_LEGEND = "The last column: how many times as far off as is usual among the others."
# Cells of a photograph that was not fitted.
_NOT_FITTED = ("not fitted", "")
# Standard errors from which on it is said where to a light turns.
_SEEN = 3.0
# Standard errors below which more digits would only hide what is large: of a level, and of a turn in degrees.
_FINEST_LEVEL = 0.001
_FINEST_TURN = 0.1
_TICKS = (0, 15, 30, 45, 60, 75, 90)


def worst_first(images: Sequence[PhotographFit]) -> list[PhotographFit]:
    """Those that stand out, then the others by what their residuals are in units of the noise."""
    return sorted(images, key=lambda image: (not image.stands_out, -image.reduced_chi2))


def photograph_table(images: Sequence[PhotographFit]) -> tuple[Sequence[str], list[tuple[str, ...]], list[int]]:
    """Head, rows of the photographs, the worst first, and which of these stand out.

    Where the light of any is judged, columns tell of it; where any stands out, one says by how much.
    """
    shown = worst_first(images)
    odd = [row for row, image in enumerate(shown) if image.stands_out]
    head: tuple[str, ...] = _COLUMNS
    body = [_errors(image) for image in shown]
    if _lights_are_judged(images):
        head = (*head, *_LIGHT_COLUMNS)
        body = [(*cells, _level(image), _turn(image.direction)) for cells, image in zip(body, shown, strict=True)]
    if odd:
        head = (*head, _ODD_COLUMN)
        body = [(*cells, _times(image)) for cells, image in zip(body, shown, strict=True)]
    return head, body, odd


def sortable_table(images: Sequence[PhotographFit], names: Sequence[str], *, viewer: bool = True) -> str:
    """The table as HTML with a button in every head and row, those that were not fitted last.

    Args:
        images: the photographs that were fitted.
        names: of all photographs of the capture, in their order.
        viewer: whether the page can show the photograph of a row.
    """
    head, body, odd = photograph_table(images)
    ordered, largest = worst_first(images), max((image.reduced_chi2 for image in images), default=0.0)
    rows = []
    for place, (image, cells) in enumerate(zip(ordered, body, strict=True)):
        texts = [escape(cell) for cell in cells]
        texts[2] += meter(image.reduced_chi2 / largest if largest else 0.0)
        keys = [*_keys(image, lights=_lights_are_judged(images))]
        rows.append(_row(names.index(image.file), texts, keys, "bold" if place in odd else "", viewer))
    fitted = {image.file for image in images}
    for number in (number for number, name in enumerate(names) if name not in fitted):
        rows.append(_row(number, [escape(names[number]), *_NOT_FITTED], [-1.0, -1.0], "", viewer))
    heads = "".join(
        f'<th{" aria-sort=descending" * (number == 2)}><button type="button">{escape(cell)}</button></th>'
        for number, cell in enumerate(head)
    )
    return (
        f'<div class="scroll"><table class="sortable"><thead><tr>{heads}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _keys(image: PhotographFit, *, lights: bool) -> Iterator[float]:
    """What the columns behind the first are sorted by, in place of their texts.

    Args:
        image: of the row.
        lights: whether columns tell of the lights.
    """
    yield -1.0 if image.relative_rmse is None else image.relative_rmse
    yield image.reduced_chi2
    if lights:
        yield 0.0 if image.level is None else abs(image.level - 1)
        yield image.direction.degrees if image.direction else 0.0
    yield image.times


def _row(number: int, cells: Sequence[str], keys: Sequence[float], kind: str, viewer: bool) -> str:
    """A row of cells of HTML, the first of which is, with a viewer, a button that shows the photograph."""
    first = f'<button type="button">{cells[0]}</button>' if viewer else cells[0]
    others = "".join(f"<td data-key={key:.6g}>{cell}</td>" for cell, key in zip(cells[1:], keys, strict=False))
    return f'<tr data-image="{number}" class="{kind}"><td>{first}</td>{others}</tr>'


def legend_of(images: Sequence[PhotographFit]) -> str:
    """What the columns of the table are that need a word."""
    judged, odd = _lights_are_judged(images), any(image.stands_out for image in images)
    return " ".join([_LEGEND] * judged + [_ODD_LEGEND] * odd)


def _lights_are_judged(images: Sequence[PhotographFit]) -> bool:
    return any(image.level is not None or image.direction is not None for image in images)


def _errors(image: PhotographFit) -> tuple[str, ...]:
    """The first cells of a row."""
    return image.file, share(image.relative_rmse), chi2(image.reduced_chi2)


def _level(image: PhotographFit) -> str:
    """How bright a photograph is beside the others, in a cell."""
    if image.level is None or image.level_std is None:
        return "-"
    return f"{image.level:.3f} ± {max(image.level_std, _FINEST_LEVEL):.3f}"


def _times(image: PhotographFit) -> str:
    """How a photograph stands out, in a cell."""
    return f"{image.times:.0f} ({image.stands_out})" if image.stands_out else ""


def angle_drawings(residuals: Mapping[str, AngularResiduals]) -> tuple[list[tuple[str, str]], str]:
    """Drawings of the residuals by each angle with their captions, and the legend of all of them; as HTML."""
    drawings, curves = [], []
    for name, found in residuals.items():
        if len(found) > 1:
            curves = [
                Curve("rms", (100 * found.rms).tolist(), COLOURS[1]),
                Curve("mean (positive: the photographs are brighter)", (100 * found.mean).tolist(), COLOURS[2]),
                Curve("rms of the noise alone", (100 * found.noise).tolist(), "currentColor", dashed=True),
            ]
            picture = drawing(found.degrees.tolist(), curves, _TICKS, f"{name} (degrees)", "residual (% of the signal)")
            drawings.append((picture, f"by {name}"))
    return drawings, legend(curves)


def _turn(turn: Turn | None) -> str:
    """The turn of a light in a cell."""
    if turn is None:
        return "-"
    text = f"{turn.degrees:.1f} ± {max(turn.std, _FINEST_TURN):.1f}°"
    if turn.toward is not None and turn.degrees > _SEEN * turn.std:
        text += f" to ({', '.join(f'{part:.2f}' for part in turn.toward)})"
    return text
