"""The corpus of faults as people make them: its entries fit their bases, and its programs run."""

from __future__ import annotations

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.corpus import SETS, Program, bases, faults, sound

from trackbench.base.types import FieldOfView, Scan

NAMES = sorted(file.parent.name for file in SETS.glob("*/faults.yaml"))
#: Programs that fail after more than five scans.
LATER = ("joseph_not_transposed", "covariances_left_at_zero", "rotated_on_one_side", "transposed_bracket")
RADAR, LIDAR = np.diag([0.3, 0.01, 0.1]) ** 2, np.diag([0.15, 0.15]) ** 2


def scans(identities: str) -> list[Scan]:
    """Five of a target at (20, 5) at rest, by a radar and a lidar that drive; the fourth misses it."""
    made = []
    for number in range(5):
        time, radar = 0.05 * number, number % 2 == 0
        ray = np.array([20.0, 5.0]) - [10 * time, 0.0]
        range_ = np.hypot(*ray)
        z = np.array([range_, np.arctan2(ray[1], ray[0]), -10 * ray[0] / range_]) if radar else ray
        valid = np.array(number != 3)
        if identities == "hidden":
            z, valid = z[:, None][:, : int(valid)], np.ones(int(valid), dtype=bool)
        elif not valid:
            z = np.full(z.shape, np.nan)
        z.setflags(write=False)
        kind, R = ("radar", RADAR) if radar else ("lidar", LIDAR)
        pose, velocity = np.array([10 * time, 0.0, 0.0]), np.array([10.0, 0.0])
        hidden = (0.95, 1e-4, FieldOfView(np.pi, np.inf)) if identities == "hidden" else (None, None, None)
        made.append(Scan(time, kind, kind, z, valid, R, pose, velocity, time, *hidden))
    return made


def answers(program: Program, folder: Path) -> list[object]:
    spec = spec_from_file_location(program.module, program.write(folder))
    module = module_from_spec(spec)
    # Data classes look for their module there.
    sys.modules[program.module] = module
    spec.loader.exec_module(module)
    tracker, state, said = module.Tracker(), None, []
    batched = getattr(tracker, "batched", False)
    for scan in scans(program.identities):
        one = scan._replace(measurement=scan.measurement[:, None], valid=scan.valid[None]) if batched else scan
        state, estimate = tracker.step(state, one)
        said.append((estimate[0][:, 0], estimate[1][..., 0]) if batched else estimate)
    return said


@pytest.mark.parametrize("name", NAMES)
def test_every_program_answers_five_scans_and_the_sound_ones_are_near_the_target(name: str, tmp_path: Path) -> None:
    for program in [*faults(name), *bases(name), *sound(name)]:
        if "exception_raised" in program.accept:
            if program.module in LATER:
                assert len(answers(program, tmp_path)) == 5
                continue
            with pytest.raises(Exception):  # noqa: B017, PT011
                answers(program, tmp_path)
            continue
        last = answers(program, tmp_path)[-1]
        assert last is not None or program.identities == "hidden", program.module
        if program.kind == "sound" and program.identities == "known":
            np.testing.assert_allclose(last[0][:2], [20.0, 5.0], atol=1.0, err_msg=program.module)
