"""Takes the pictures of recordings in README.md and docs/ with the viewer: ``python docs/recording_figure.py``."""

import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

import trackbench
from trackbench.subjects.recording.focus import Opening
from trackbench.subjects.recording.viewer import pictures, playable

IMAGES = Path(__file__).parent / "images"
#: Pixels of the window.
SIZE = (1230, 770)


def main(folder: Path) -> None:
    """Run the scenarios, and write the pictures."""
    for scenario, opening, name in (
        ("highway", Opening(), "recording"),
        ("traffic/truck_hides_car", Opening(worst=1, tracker="gnn"), "traffic-recording"),
    ):
        result = trackbench.run(scenario, out=folder)
        with playable(folder / result.name, opening) as (file, moment):
            (still,) = pictures(file, [moment], SIZE)
        Image.open(io.BytesIO(still)).convert("RGB").save(IMAGES / f"{name}.png", optimize=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder))
