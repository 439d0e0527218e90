"""Takes the pictures of recordings in README.md and docs/ with the viewer: ``python docs/recording_figure.py``."""

import io
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import trackbench
from trackbench.subjects.recording.focus import Opening
from trackbench.subjects.recording.viewer import pictures, playable

IMAGES = Path(__file__).parent / "images"
#: Pixels of the window.
SIZE = (1230, 770)
#: Seconds before and after the moment, and pictures in a second.
BEFORE_S, AFTER_S, RATE = 2.5, 4.5, 10
#: The part of the window that has the scene, and the size of the animation, pixels.
SCENE, SMALL = (0, 37, 922, 348), (922, 311)


def main(folder: Path) -> None:
    """Run the scenarios, and write the pictures."""
    for scenario, opening, name in (
        ("highway", Opening(), "recording"),
        ("traffic/truck_hides_car", Opening(worst=1, tracker="gnn"), "traffic-recording"),
    ):
        result = trackbench.run(scenario, out=folder)
        with playable(folder / result.name, opening) as (file, moment):
            times = [moment, *(moment + np.arange(-BEFORE_S, AFTER_S, 1 / RATE) if name == "recording" else ())]
            shown = pictures(file, times, SIZE)
            still, *frames = (Image.open(io.BytesIO(png)).convert("RGB") for png in shown)
        still.save(IMAGES / f"{name}.png", optimize=True)
        if frames:
            first, *others = (frame.crop(SCENE).resize(SMALL) for frame in frames)
            look = {"duration": 1000 // RATE, "loop": 0, "quality": 80, "method": 6}
            first.save(IMAGES / f"{name}.webp", save_all=True, append_images=others, **look)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder))
