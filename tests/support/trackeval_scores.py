"""Boxes and tracks as frames of data, as files of benchmarks, and what TrackEval makes of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tests.metrics.traffic.sequences import Similarities
from trackeval.metrics import CLEAR, HOTA, Identity

FRAMES, RATE, CUTOFF = 80, 10.0, 5.0


def drawn(seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Boxes of three cars, and tracks that miss, change their ids, and are false: frame, id, x, y."""
    random = np.random.default_rng(seed)
    frame = np.arange(FRAMES)
    boxes = [
        pd.DataFrame({"frame": frame, "id": car + 1, "x": 1.5 * frame + 6 * car, "y": 4.0 * car}) for car in range(3)
    ]
    truth = pd.concat(boxes, ignore_index=True)
    tracks = truth[random.random(len(truth)) > 0.15].copy()
    tracks[["x", "y"]] += random.normal(0, 1.2, (len(tracks), 2))
    # Two tracks change places half way, and one goes on under another id.
    late = tracks.frame >= FRAMES // 2
    tracks["id"] = np.where(late & tracks.id.isin((1, 2)), 3 - tracks.id, tracks.id)
    tracks["id"] = np.where(late & (tracks.id == 3), 7, tracks.id)
    false = pd.DataFrame({"frame": random.integers(0, FRAMES, 12), "id": np.arange(20, 32), "x": 50.0, "y": -9.0})
    return truth, pd.concat([tracks, false], ignore_index=True).sort_values(["frame", "id"], ignore_index=True)


def by_trackeval(sequences: Sequence[tuple[pd.DataFrame, pd.DataFrame]]) -> dict[str, float]:
    """HOTA, MOTA and IDF1 over all sequences, each of boxes and tracks: TrackEval's COMBINED_SEQ."""
    quiet = {"PRINT_CONFIG": False}
    scores: dict[str, Any] = {}
    for metric in (HOTA(), CLEAR(quiet), Identity(quiet)):
        each = {str(k): metric.eval_sequence(_similarities(*pair).for_trackeval()) for k, pair in enumerate(sequences)}
        scores |= metric.combine_sequences(each)
    return {name: float(np.mean(scores[name])) for name in ("HOTA", "MOTA", "IDF1")}


def _similarities(truth: pd.DataFrame, tracks: pd.DataFrame) -> Similarities:
    frames, places = int(truth.frame.max()) + 1, []
    for rows in (truth, tracks):
        names, number = np.unique(rows.id, return_inverse=True)
        place = np.full((frames, len(names), 2), np.nan)
        place[rows.frame, number] = rows[["x", "y"]]
        places.append(place)
    apart = np.linalg.norm(places[0][:, :, None] - places[1][:, None], axis=-1)
    there = (np.isfinite(place[..., 0]) for place in places)
    return Similarities(np.nan_to_num(np.maximum(1 - apart / CUTOFF, 0)), *there)


def as_motchallenge(rows: pd.DataFrame, file: Path) -> None:
    file.write_text("".join(f"{r.frame + 1},{r.id},-1,-1,-1,-1,1,{r.x!r},{r.y!r},0\n" for r in rows.itertuples()))


def as_kitti(rows: pd.DataFrame, file: Path) -> None:
    numbers = "{0.frame} {0.id} Car 0 0 0 1 2 3 4 1.5 1.8 4.5 {y!r} 1.5 {0.x!r} 0\n"
    file.write_text("".join(numbers.format(r, y=-r.y) for r in rows.itertuples()))
