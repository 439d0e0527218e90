"""The corpus of faults as people make them: its entries fit their bases, and its programs run."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.corpus import KINDS, SETS, Fault, Program, bases, faults, replaced, sound

from trackbench.base.types import FieldOfView, Scan
from trackbench.subjects.doctor.findings import known_faults

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


@pytest.mark.parametrize("name", NAMES)
def test_every_fault_is_of_a_kind_and_its_names_are_known_or_marked(name: str) -> None:
    known, text = known_faults(), (SETS / name / "faults.yaml").read_text(encoding="utf-8")
    programs = faults(name)
    for program in programs:
        assert program.kind in KINDS
        assert program.entry.source.startswith("https://"), program.module
        assert program.lines, program.module
        for fault in program.accept:
            marked = re.search(rf"accept: .*\b{fault}\b.*#", text)
            assert fault in known or marked, f"{program.module}: {fault} is not known, and has no comment"
    modules = [program.module for program in [*programs, *sound(name), *bases(name)]]
    assert len(set(modules)) == len(modules)


def test_the_parts_are_found_where_only_the_folder_of_the_benchmarks_is_on_the_path(tmp_path: Path) -> None:
    code = f"import sys; sys.path.insert(0, {str(SETS.parent)!r}); import faults.corpus; import benchmarks.faults.parts"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)


def test_a_replacement_says_which_lines_differ_and_wants_its_text_once() -> None:
    entry = Fault(
        "x", "b", "single", "", "", [{"old": "c = 3", "new": "c = 4\nd = 5"}, {"old": "a", "new": "c = 3"}], []
    )
    assert replaced("a\nb\nc = 3\n", entry) == ("c = 3\nb\nc = 4\nd = 5\n", {1, 3, 4})
    with pytest.raises(ValueError, match="has 2 times: a"):
        replaced("a\na\nc = 3\n", entry)
