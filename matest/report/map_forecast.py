"""What each number of photographs allows of maps, as the terminal shows it."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Column, Table
from rich.text import Text

from matest.identifiability import MapForecast, MapsForecast
from matest.report.format import listed, percent, short
from matest.report.tables import plain_table

# Columns beside each other: more do not fit.
_MAX_COLUMNS = 5
# Share of the pixels that the photographs light at which a parameter has to be known, if it is to count as a map.
_A_MAP = 0.5
# Relative error of a pixel that says nothing: what it is then is a matter of the domain.
_NO_VALUE = 0.995
# Images that a sentence names.
_MAX_NAMED = 12


def maps_report(maps: MapsForecast) -> list[Text | Table]:
    """A row for each number of photographs, and what follows from it in words."""
    names = _short_names(maps)
    columns = _columns(maps, names)
    more = len(columns) - (_MAX_COLUMNS - 1)
    sentences = [
        *_one_photograph(maps, names),
        *_of_maps(maps, names),
        *_in_common(maps, names),
        _legend(maps, names),
        *_up_to_scale(maps, names),
        *([f"{more} more column{'s' * (more != 1)}: --json."] if more > 0 else []),
    ]
    return [_table(columns, maps), *(Text(sentence) for sentence in sentences)]


def _short_names(maps: MapsForecast) -> dict[str, str]:
    """What parameters are called, by path."""
    every = [*maps.parameters, *maps.photographs[-1].common]
    return {name: short(name, every) for name in every}


def _columns(maps: MapsForecast, names: dict[str, str]) -> dict[str, list[str]]:
    """By their head: shares of the pixels that are known, with the error of a typical one, and what is in common."""
    rows, last = maps.photographs, maps.photographs[-1]
    return {
        **{f"{names[name]}\nknown, error": [_of_map(row.maps[name]) for row in rows] for name in maps.parameters},
        **{f"{names[name]}\nin common": [_error(row.common[name]) for row in rows] for name in last.common},
        **{f"{names[name]}\nas one value": [_error(row.as_one[name]) for row in rows] for name in last.as_one},
    }


def _table(columns: dict[str, list[str]], maps: MapsForecast) -> Table:
    """As many of the columns as fit beside each other."""
    shown = [*columns][: _MAX_COLUMNS - 1]
    table = plain_table(
        Column("photographs", justify="right", no_wrap=True),
        *(Column(head, justify="right", overflow="fold") for head in shown),
        title="Maps by number of photographs",
    )
    for number, row in enumerate(maps.photographs):
        table.add_row(str(len(row.images)), *(columns[head][number] for head in shown))
    return table


def _of_map(forecast: MapForecast) -> str:
    """`84%, ± 3.1%`."""
    if forecast.relative is None:
        return "0%"
    middle = forecast.relative[1]
    return f"{_share(forecast.known)}, {f'± {percent(middle)}' if middle < _NO_VALUE else '> 100%'}"


def _error(relative: float | None) -> str:
    return "-" if relative is None else f"± {percent(relative)}"


def _share(value: float) -> str:
    """A share of the pixels."""
    return f"{100 * value:.0f}%"


def _one_photograph(maps: MapsForecast, names: dict[str, str]) -> list[str]:
    """What a single photograph tells."""
    first = maps.photographs[0]
    told = [name for name in _amplitudes(maps) if _is_map(first.maps[name].known, maps)]
    if len(first.images) > 1 or not told:
        return []
    alike = {**first.common, **{name: first.as_one[name] for name in _shapes(maps) if name not in told}}
    known = [f"{names[name]} ({_error(error)})" for name, error in alike.items() if error is not None]
    unknown = [names[name] for name, error in alike.items() if error is None]
    given = [f"with one {listed(known)} of the whole object"] * bool(known)
    given += [f"for a given {listed(unknown)}, which it does not tell"] * bool(unknown)
    words = f"One photograph tells {listed([names[name] for name in told])} at "
    words += f"{_share(min(first.maps[name].known for name in told))} of the object's pixels (it lights "
    return [", ".join([f"{words}{_share(first.lit)})", *given]) + "."]


def _of_maps(maps: MapsForecast, names: dict[str, str]) -> list[str]:
    """How many photographs each map needs, but for those that one photograph tells."""
    last, sentences = maps.photographs[-1], []
    for name in maps.parameters:
        label, forecast = names[name], last.maps[name]
        needed = _needed(maps, [_is_map(row.maps[name].known, maps) for row in maps.photographs])
        if needed == 1 and name in _amplitudes(maps):
            continue
        if needed is not None:
            span = _span_of_needed(maps, name)
            sentences.append(f"{label} needs {_photographs(needed)} to be known at half of the lit pixels{span}.")
            continue
        span = ""
        if forecast.known_range is not None:
            low, high = (_share(end) for end in forecast.known_range)
            span = f" ({low} to {high} over the range)" if low != high else ""
        whole = f"the object's ({_error(last.as_one[name])})" if last.as_one.get(name) else "what the object has"
        sentences.append(
            f"{label} stays common to most pixels: {_all(maps)} {_share(forecast.known)} of the object's pixels"
            f"{span}; the others take {whole}."
        )
    return sentences


def _span_of_needed(maps: MapsForecast, name: str) -> str:
    """The numbers of photographs over the range of shapes, if they differ."""
    ranges = [row.maps[name].known_range for row in maps.photographs]
    several = [each for each in ranges if each is not None]
    if len(several) < len(ranges):
        return ""
    least, most = (_needed(maps, [_is_map(each[end], maps) for each in several]) for end in (1, 0))
    if least == most:
        return ""
    end = f"more than {len(maps.photographs[-1].images)}" if most is None else str(most)
    return f" ({least} to {end} over the range)"


def _in_common(maps: MapsForecast, names: dict[str, str]) -> list[str]:
    """How many photographs the parameters in common need."""
    by_need: dict[int | None, list[str]] = {}
    for name in maps.photographs[-1].common:
        needed = _needed(maps, [row.common[name] is not None for row in maps.photographs])
        by_need.setdefault(needed, []).append(names[name])
    sentences = []
    for needed, some in by_need.items():
        is_one = len(some) == 1
        stays = f"{listed(some)}, in common to all pixels, "
        if needed is None:
            sentences.append(f"{stays}{'is' if is_one else 'are'} not determined by these photographs beside the maps.")
        else:
            sentences.append(f"{stays}{'needs' if is_one else 'need'} {_photographs(needed)}.")
    return sentences


def _legend(maps: MapsForecast, names: dict[str, str]) -> str:
    """What the numbers of the table are."""
    limits: dict[float, list[str]] = {}
    for name, each in maps.parameters.items():
        limits.setdefault(each.limit, []).append(names[name])
    words = ", ".join(f"{listed(some)} to {percent(limit)}" for limit, some in limits.items())
    images = maps.photographs[-1].images
    order = ", ".join(map(str, images[:_MAX_NAMED])) + " and so on" * (len(images) > _MAX_NAMED)
    chosen = f" A row has the images that tell most, each beside those before it: {order}." if len(images) > 1 else ""
    return (
        f"known: share of the object's pixels that tell {words}, as estimate decides; error: of the median lit pixel, "
        f"by the noise alone, every pixel having the assumed values.{chosen}"
    )


def _up_to_scale(maps: MapsForecast, names: dict[str, str]) -> list[str]:
    """What an unknown strength of the lights leaves open."""
    scaled = [names[name] for name in _amplitudes(maps)]
    if not maps.relative or not scaled:
        return []
    return [
        f"The map of {listed(scaled)} is known up to one scale, that of the lights, with any number of photographs: "
        "its errors are those of ratios between pixels."
    ]


def _amplitudes(maps: MapsForecast) -> list[str]:
    return [name for name, each in maps.parameters.items() if not each.is_shape]


def _shapes(maps: MapsForecast) -> list[str]:
    return [name for name, each in maps.parameters.items() if each.is_shape]


def _is_map(known: float, maps: MapsForecast) -> bool:
    """Whether so many of the object's pixels known make a map."""
    lit = maps.photographs[-1].lit
    return lit > 0 and known >= _A_MAP * lit


def _needed(maps: MapsForecast, suffices: Sequence[bool]) -> int | None:
    """The least number of photographs from which on they suffice; None: all of them do not."""
    needed = None
    for row, enough in zip(reversed(maps.photographs), reversed(suffices), strict=True):
        if not enough:
            break
        needed = len(row.images)
    return needed


def _photographs(count: int) -> str:
    return f"{count} photograph{'s' * (count != 1)}"


def _all(maps: MapsForecast) -> str:
    """`all 12 photographs tell it at`."""
    count = len(maps.photographs[-1].images)
    return f"all {count} photographs tell it at" if count > 1 else "the photograph tells it at"
