"""The page of the sensor presets, made from ``presets.yaml``.

``python -m trackbench.sensing.docs`` prints it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator

from trackbench.models.sensors.presets import Preset, list_presets

INTRODUCTION = """\
# Sensor presets

<!-- Made from the presets by `python -m trackbench.sensing.docs`. Change presets.yaml, not this page. -->

Published figures of real sensors, named in a scenario as `preset:`; a key that the scenario writes itself wins over the
preset's. What each key means is in [sensors](sensors.md).

Makers rarely say what "accuracy" means. Where the source states no standard deviation, the figure is taken as one: the
cautious measurement, as a bound or a two-sigma figure would mean less noise. A figure that no source gives is marked
assumed, with the reason. A lidar's figure is that of a single point; the position of a whole vehicle, found from its
points, is less certain: set `position_sigma_m` where that matters.
"""


def presets_markdown() -> str:
    """The whole page."""
    blocks = [INTRODUCTION, *(block for preset in list_presets() for block in _preset(preset))]
    return "\n\n".join(block.rstrip("\n") for block in blocks) + "\n"


def _preset(preset: Preset) -> Iterator[str]:
    yield f"## {preset.name}"
    yield f"{preset.title}; type `{preset.kind}`."
    yield f"Source: {preset.source}."
    rows = ["| key | value | from |", "| --- | ---: | --- |"]
    for key, value in preset.values.items():
        origin = preset.sources.get(key) or f"assumed: {preset.assumed[key]}"
        shown = f"{value:g}" if isinstance(value, int | float) else f"`{json.dumps(value)}`"
        rows.append(f"| `{key}` | {shown} | {origin} |")
    yield "\n".join(rows)


if __name__ == "__main__":
    print(presets_markdown(), end="")
