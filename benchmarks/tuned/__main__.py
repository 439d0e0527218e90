"""Tune every tracker by one protocol, compare them on other scenes (results/tuned/), and give the shipped scenarios the
values of their family.

python -m benchmarks.tuned [--scores-only] [--resume FOLDER]
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import yaml

from .protocol import read
from .scores import scored
from .shipped import update
from .tuning import all_tuned

OUT = Path(__file__).parents[2] / "results" / "tuned"


def main() -> None:
    arguments = argparse.ArgumentParser(prog="python -m benchmarks.tuned", description=__doc__)
    arguments.add_argument("--scores-only", action="store_true", help="with the values that are there")
    arguments.add_argument("--workers", type=int, default=2)
    arguments.add_argument("--resume", type=Path, help="folder of the trials, from which an interrupted search goes on")
    given = arguments.parse_args()
    # Before a worker imports NumPy: the linear algebra of each would take every core.
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    protocol, values = read(), OUT / "values.yaml"
    OUT.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
        if not given.scores_only:
            best = {tracker: {} for tracker in protocol.trackers}
            for tracker, name, of in all_tuned(protocol, pool, given.resume):
                print(f"{tracker}, {name}: {of}", flush=True)
                best[tracker][name] = of
            values.write_text(yaml.safe_dump(best, sort_keys=False), encoding="utf-8")
        best = yaml.safe_load(values.read_text(encoding="utf-8"))
        scored(protocol, best, pool, OUT)
    update(protocol, best)


if __name__ == "__main__":
    main()
