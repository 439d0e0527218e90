"""What the faults of a set do: 20 runs of one scene of 10 s, the set's own where its folder has one.

    python -m benchmarks.faults.harm SET [--only TEXT]

Prints of each program the position RMSE (of several objects: GOSPA), that over the base's, and the mean NEES (4 is
right), and writes the last two into the set's faults.yaml.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml

import trackbench as tb

from .corpus import SETS, Fault, Program, bases, faults, sound

ERROR = {"known": "position_rmse", "hidden": "gospa"}


def measured(programs: list[Program], name: str) -> dict[str, tuple[float, float]]:
    """Error and mean NEES of each program that gave estimates at every scan, by its module."""
    found: dict[str, tuple[float, float]] = {}
    with TemporaryDirectory() as folder:
        for program in programs:
            program.write(Path(folder))
        for identities, error in ERROR.items():
            chosen = [program for program in programs if program.identities == identities]
            if not chosen:
                continue
            places = (SETS / name / f"{identities}.yaml", SETS / f"{identities}.yaml")
            scene = yaml.safe_load(next(file for file in places if file.exists()).read_text(encoding="utf-8"))
            scene["trackers"] = {program.module: {"use": program.reference} for program in chosen}
            file = Path(folder) / f"{identities}.yaml"
            file.write_text(yaml.safe_dump(scene), encoding="utf-8")
            result = tb.run(str(file))
            for program in chosen:
                values = [result[program.module].metrics[metric].value for metric in (error, "nees")]
                if None not in values:
                    found[program.module] = (values[0], values[1])
    return found


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("set")
    arguments.add_argument("--only", default="", help="programs whose names contain this, or whose base's do")
    given = arguments.parse_args()
    origins = {program.module: program for program in bases(given.set)}
    faulty = [one for one in faults(given.set) if given.only in one.module or given.only in one.entry.base]
    others = [one for one in (*origins.values(), *sound(given.set)) if given.only in one.module]
    needed = [origins[one.entry.base] for one in faulty if origins[one.entry.base] not in others]
    found = measured([*dict.fromkeys([*needed, *others]), *faulty], given.set)
    file = SETS / given.set / "faults.yaml"
    text = file.read_text(encoding="utf-8")
    for program in [*dict.fromkeys([*needed, *others]), *faulty]:
        error, nees = found.get(program.module, (np.nan, np.nan))
        line, harm = f"{program.module}: {error:.3f} m, NEES {nees:.3g}", "null  # it does not get to the end"
        if isinstance(program.entry, Fault):
            if program.module in found:
                ratio = error / found[program.entry.base][0]
                line, harm = f"{line}, {ratio:.2f} of {program.entry.base}'s", f"[{ratio:.3g}, {nees:.3g}]"
            entry = re.compile(rf"(- name: {re.escape(program.entry.name)}\n(?:  .*\n)*?)(?:  harm: .*\n)?(?=- |\Z|\n)")
            text, count = entry.subn(rf"\g<1>  harm: {harm}\n", text)
            assert count == 1, program.entry.name
        print(line, flush=True)
    file.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
