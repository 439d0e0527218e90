"""Score perfect tracks whose time stamps jitter: the table of docs/tracks-from-elsewhere.md.

python -m benchmarks.jitter
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

import trackbench as tb

#: Largest distance of a stamp from its frame, as a share of the period; rates of tracks and of boxes, Hz.
JITTERS = (0.0, 0.1, 0.2, 0.3, 0.4)
RATES = (5, 10, 20, 50)
TRUTH_RATES = (10, 20, 50, 100)
SECONDS = 60.0
#: One row in so many is missing.
MISSING = 5


def on_path(time: np.ndarray) -> pd.DataFrame:
    """Return rows of a car that weaves and changes its speed, exactly where it is at its stamps."""
    return pd.DataFrame({"time": time, "id": 1, "x": 10 * time + 3 * np.sin(time), "y": 2 * np.sin(time / 2)})


def stamps(random: np.random.Generator, rate: float, jitter: float, *, missing: bool = False) -> np.ndarray:
    """Return stamps of frames at a rate, each off by up to a share of the period, every fifth perhaps missing."""
    frame = np.arange(1, SECONDS * rate)
    time = (frame + random.uniform(-jitter, jitter, len(frame))) / rate
    return time[frame % MISSING > 0] if missing else time


def scores(folder: Path, seed: int, rate: float, jitter: float, *, missing: bool) -> np.ndarray:
    """Return matched share and HOTA, each the smallest and the largest over the rates of the boxes ``(2, 2)``."""
    reached = []
    for truth_rate in TRUTH_RATES:
        on_path(np.arange(0, SECONDS, 1 / truth_rate)).to_csv(folder / "boxes.csv", index=False)
        random = np.random.default_rng([seed, rate, truth_rate, int(100 * jitter), missing])
        on_path(stamps(random, rate, jitter, missing=missing)).to_csv(folder / "tracks.csv", index=False)
        result = tb.score(folder / "tracks.csv", folder / "boxes.csv")["tracks"]
        reached.append([result.matched_share.value, result.hota.value])
    return np.array([np.min(reached, axis=0), np.max(reached, axis=0)]).T


def main() -> None:
    print("| jitter, % of the period |", " | ".join(f"{rate} Hz" for rate in RATES), "|")
    print("| :-- |" + " --: |" * len(RATES))
    with tempfile.TemporaryDirectory() as name:
        for missing in (False, True):
            for jitter in JITTERS:
                cells = []
                for rate in RATES:
                    (matched, most), (hota, _) = scores(Path(name), 2, rate, jitter, missing=missing)
                    spread = f" to {100 * most:.1f}" if missing else f", {hota:.3f}"
                    cells.append(f"{100 * matched:.1f}{spread}")
                what = ", every fifth row missing" if missing else ""
                print(f"| ±{100 * jitter:.0f}{what} |", " | ".join(cells), "|")


if __name__ == "__main__":
    main()
