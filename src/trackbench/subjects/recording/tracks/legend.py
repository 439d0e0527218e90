"""What a recording of tracks shows, in its legend."""

from __future__ import annotations

from collections.abc import Mapping

from trackbench.document.palette import BOUND_COLOUR, IDENTITY_COLOURS, OBSERVER_COLOUR, sensor_colours
from trackbench.document.replay import NamedColour
from trackbench.subjects.recording.tracks.scene import ASSOCIATION_COLOUR, MARKED, MISSED

#: The first identity's on the dark ground, at an existence probability of 0.4.
FAINT_COLOUR = "#85863F"


def track_entries(trackers: Mapping[str, str], sensors: list[str]) -> list[NamedColour]:
    """What is in the scene, and the trackers, whose colours are those of the plots."""
    return [
        NamedColour("tracks", IDENTITY_COLOURS[0], "dot", IDENTITY_COLOURS[1:]),
        NamedColour("faint: unsure", FAINT_COLOUR, "dot"),
        NamedColour("due, no track", MISSED, "ring"),
        NamedColour("false track", MARKED["false"], "mark"),
        NamedColour("lost, merged", MARKED["lost"], "mark"),
        NamedColour("switch", MARKED["switched"], "mark"),
        *(NamedColour(name, colour, "dot") for name, colour in sensor_colours(sensors).items()),
        NamedColour("association", ASSOCIATION_COLOUR, "line"),
        NamedColour("truth", BOUND_COLOUR),
        NamedColour("observer", OBSERVER_COLOUR),
        *(NamedColour(f"{name} (plots)", colour) for name, colour in trackers.items()),
    ]
