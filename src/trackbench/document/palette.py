"""Colours of trackers, sensors and modes in reports and recordings, distinct also to a colour-blind reader.

The first six are Okabe and Ito's (jfly.uni-koeln.de/color). The rest differ from them and from each other under
simulated protanopia and deuteranopia. All are readable on a dark and on a white ground.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from trackbench.document import Figure, LegendEntry, TrackerStyle

if TYPE_CHECKING:
    from matplotlib import figure as canvas

TRACKER_COLOURS: tuple[str, ...] = (
    "#E69F00",
    "#56B4E9",
    "#009E73",
    "#CC79A7",
    "#D55E00",
    "#0072B2",
    "#8B6DFF",
    "#A03366",
    "#80BA5A",
    "#B42D00",
    "#8700F0",
    "#D200B4",
    "#D2A5A5",
    "#5A96E1",
    "#006987",
    "#3C692D",
    "#F05A78",
    "#00963C",
)
SENSOR_COLOURS: tuple[str, ...] = ("#C9B400", "#3CC3D2", "#E1A587", "#6978D2", "#F05A4B", "#5AA5FF")
#: Colours of the modes of a tracker with several motion models.
MODE_COLOURS: tuple[str, ...] = ("#5B8FF9", "#E8A33D", "#9270CA", "#3FA796", "#D9648A", "#8A9099")
#: Colours of tracks on a dark ground, lighter than all colours of trackers and sensors.
IDENTITY_COLOURS: tuple[str, ...] = ("#FFFA5F", "#93F4FF", "#F4BB89", "#B1FCA7", "#BECEED", "#FEE7D8", "#E5DB76")
#: Colours of small to large faults, in one hue that no tracker or sensor has.
ERROR_COLOURS: tuple[str, ...] = ("#FFC2C2", "#FF7A7A", "#FF1F1F")
TRUTH_COLOUR = "#8A9099"
OBSERVER_COLOUR = "#5A87C6"
BOUND_COLOUR = "#8A9099"


def mode_colours(names: Iterable[str]) -> dict[str, str]:
    """Return a colour for each mode of a filter, by name, in order of appearance; colours repeat after six."""
    return {name: MODE_COLOURS[i % len(MODE_COLOURS)] for i, name in enumerate(dict.fromkeys(names))}


def sensor_colours(names: Iterable[str]) -> dict[str, str]:
    """Return a colour for each sensor, by name, in their order; colours repeat after six."""
    return {name: SENSOR_COLOURS[i % len(SENSOR_COLOURS)] for i, name in enumerate(dict.fromkeys(names))}


#: Styles by the name of the tracker.
Styles = Mapping[str, TrackerStyle]
_LINES = (("solid", ""), ((0, (6, 1.5, 1.5, 1.5)), "s"), ((0, (1.5, 1.5)), "^"))


def tracker_styles(places: Mapping[str, int] | Sequence[str]) -> Styles:
    """Return the style of each tracker by name; trackers with equal colours differ in line and marker.

    Args:
        places: index of each tracker in its scenario, which determines the colour; or all names in the order of the
            scenario file.
    """
    if not isinstance(places, Mapping):
        places = {name: place for place, name in enumerate(places)}
    styles: dict[str, TrackerStyle] = {}
    used = Counter[str]()
    for number, (name, place) in enumerate(places.items()):
        colour = TRACKER_COLOURS[place % len(TRACKER_COLOURS)]
        styles[name] = TrackerStyle(f"t{number}", name, colour, *_LINES[used[colour] % len(_LINES)])
        used[colour] += 1
    return styles


def tracker_colours(places: Mapping[str, int]) -> dict[str, str]:
    """Return a colour for each tracker in a recording, whose lines have no dashes; colours repeat once all are used."""
    colours = {name: style.colour for name, style in tracker_styles(places).items() if style.line == "solid"}
    free = [colour for colour in TRACKER_COLOURS if colour not in colours.values()] or TRACKER_COLOURS
    dashed = [name for name in places if name not in colours]
    colours |= {name: free[i % len(free)] for i, name in enumerate(dashed)}
    return {name: colours[name] for name in places}


def tracker_figure(
    name: str,
    title: str,
    caption: str,
    alternative: str,
    paint: Callable[[canvas.Figure], None],
    height: float,
    styles: Sequence[TrackerStyle],
    *others: LegendEntry,
) -> Figure:
    """Return a figure with trackers in its tooltips and legend; ``others`` are further legend entries."""
    lines = (LegendEntry(s.name, s.colour, "line" if s.line == "solid" else "dash", s.key) for s in styles)
    tooltips = {style.key: style.name for style in styles}
    return Figure(name, title, caption, alternative, paint, height, legend=(*lines, *others), tooltips=tooltips)
