"""Measure the claims and write results/calibration.md and .json.

    python -m benchmarks.calibration [SUBJECT...]

With subjects, only those are measured; the others stay in the table as they were. Exit status 1 where a claim is
measured beyond what is wanted.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from .subjects import load, measure, save, subjects


def main() -> int:
    known = subjects()
    arguments = argparse.ArgumentParser(prog="python -m benchmarks.calibration", description="Measure the claims.")
    arguments.add_argument("subjects", nargs="*", metavar="SUBJECT", help=f"of {', '.join(known)}; all unless given")
    arguments.add_argument("--workers", type=int, default=2)
    given = arguments.parse_args()
    for name in given.subjects:
        if name not in known:
            arguments.error(f"no subject {name!r}; there are {', '.join(known)}")
    chosen = given.subjects or known
    measured = {}
    # Before a worker imports NumPy: the linear algebra of each would take every core.
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
        for name, claims in zip(chosen, pool.map(measure, chosen), strict=True):
            measured[name] = claims
            for claim in claims:
                print(f"{claim.outcome}  {name}: {claim.what}: {claim.measured}, wanted {claim.wanted}", flush=True)
    # Others may have been measured meanwhile.
    table = load() | measured
    save({name: table[name] for name in known if name in table})
    return 0 if all(claim.holds for name in chosen for claim in measured[name]) else 1


if __name__ == "__main__":
    sys.exit(main())
