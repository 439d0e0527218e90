"""Trackers in C and C++: the shipped examples, as programs, beside the same filter inside."""

from __future__ import annotations

import random
import struct
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from tests.support.languages import LANGUAGES, SANITIZED, compiled, examples

from trackbench.base.types import Scan, scan_of_member
from trackbench.driving.faults import TrackFault
from trackbench.driving.frames import scan_frames
from trackbench.driving.isolation import Isolation
from trackbench.driving.start import ending, start_stepper
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.sensing.scans import ideal_sensors, sense_known
from trackbench.trackers.config import FilterConfig, PluginConfig

SCENARIO = """
name: beside
truth:
  source: scripted
  duration_s: 8
  rate_hz: 20
  observer: {x: -5, y: 2, yaw_deg: 20}
  objects:
    first: {start: {x: 40, y: -20, speed_mps: 8, course_deg: 120}, pieces: [{for_s: 8, turn_rate_degps: 10}]}
    second: {start: {x: -30, y: 3, speed_mps: 12, course_deg: 5}, pieces: [{for_s: 8, acceleration_mps2: 1}]}
sensors:
  front: {type: radar, rate_hz: 20, mount: {x_m: 2, yaw_deg: 150}, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5,
          range_rate_sigma_mps: 0.1, detection_probability: 0.8}
  roof: {type: lidar, rate_hz: 10, position_sigma_m: 0.15, detection_probability: 0.9}
trackers:
  inside: {filter: ekf, motion: cv, acceleration_sigma_mps2: 2.5, initial: {velocity: zero}}
monte_carlo: {runs: 4, seed: 3}
"""
OPTIONS = {"options": {"acceleration_sigma": 2.5}}
#: Largest difference from the filter inside, relative to the largest entry.
SAME = 1e-9


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    examples(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> list[Scan]:
    file = tmp_path_factory.mktemp("beside") / "beside.yaml"
    file.write_text(SCENARIO)
    loaded = load_scenario(file)
    truth = truths_of(loaded)[0].truth
    return sense_known(ideal_sensors(truth, loaded.config.sensors), 3, "beside", range(4)).scans


def estimates(folder: Path, entry: Any, scans: Sequence[Scan]) -> list[Any]:
    config = (FilterConfig if "filter" in entry else PluginConfig).model_validate(entry)
    batch = scans[0].valid.size
    with ending(start_stepper(config, folder, batch, lambda tracker: tracker, Isolation(), sensors={})) as stepper:
        state, answers = None, []
        for scan in scans:
            state, answer = stepper.step(state, scan)
            answers.append(answer)
        return answers


def require_alike(inside: Sequence[Any], outside: Sequence[Any]) -> None:
    compared = 0
    for expected, estimate in zip(inside, outside, strict=True):
        for name in ("mean", "covariance"):
            if estimate is None:
                assert np.isnan(getattr(expected, name)).all()
                continue
            ours, theirs = getattr(expected, name), getattr(estimate, name)
            axes = tuple(range(ours.ndim - 1))
            np.testing.assert_array_less(np.abs(ours - theirs).max(axis=axes), SAME * np.abs(ours).max(axis=axes))
            compared += ours.shape[-1]
    assert compared > 1000


INSIDE = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 2.5, "initial": {"velocity": "zero"}}


def test_the_filter_in_c_plus_plus_is_that_inside(folder: Path, scans: list[Scan]) -> None:
    compiled(folder, "tracker.cpp")
    inside = estimates(folder, INSIDE, scans)
    program = {"use": {"command": ["./tracker"]}}
    require_alike(inside, estimates(folder, program | OPTIONS, scans))
    arguments = {"use": {"command": ["./tracker", "--acceleration_sigma", "2.5"]}}
    require_alike(inside, estimates(folder, arguments, scans))


def test_the_example_in_c_follows(folder: Path, scans: list[Scan]) -> None:
    compiled(folder, "tracker.c")
    program = estimates(folder, {"use": {"command": ["./tracker"]}}, scans)
    inside = estimates(folder, INSIDE, scans)[-1]
    assert np.abs(program[-1].mean[:2] - inside.mean[:2]).max() < 3.0


def test_what_it_throws_is_one_clear_line(folder: Path, scans: list[Scan]) -> None:
    (folder / "tracker.cpp").write_text(
        '#include "trackbench.hpp"\n#include <iostream>\n#include <stdexcept>\n'
        "struct Mine {\n    explicit Mine(const trackbench::Options &) {}\n"
        "    std::optional<trackbench::Estimate> step(const trackbench::Scan &) {\n"
        '        std::cout << "printed" << std::endl;\n'
        '        throw std::runtime_error("no such sensor");\n    }\n};\n'
        "TRACKBENCH_TRACKER(Mine)\n"
    )
    compiled(folder, "tracker.cpp")
    with pytest.raises(TrackFault, match=r"/tracker.*: no such sensor"):
        estimates(folder, {"use": {"command": ["./tracker"]}}, scans[:2])


BATCHED = """
#include "trackbench.hpp"
struct Mine {
    static constexpr bool batched = true;
    explicit Mine(const trackbench::Options &) {}
    bool step(const trackbench::Scan &scan, double *mean, double *covariance) {
        const int64_t n = scan.batch;
        for (int64_t k = 0; k < n; k++) {
            for (int i = 0; i < 4; i++) mean[i * n + k] = scan.valid[k] ? scan.measurement[(i % 2) * n + k] : NAN;
            for (int i = 0; i < 16; i++) covariance[i * n + k] = i % 5 == 0;
        }
        return true;
    }
};
TRACKBENCH_TRACKER(Mine)
"""


def test_a_batch_is_one_step(folder: Path, scans: list[Scan]) -> None:
    (folder / "batched.cpp").write_text(BATCHED)
    valid = np.array([True, False, False])
    measurement = np.where(valid, np.arange(6.0).reshape(2, 3), np.nan)
    scan = scans[0]._replace(noise_covariance=np.eye(2))
    labelled = scan._replace(measurement=measurement, valid=valid)
    compiled(folder, "batched.cpp")
    (estimate,) = estimates(folder, {"use": {"command": ["./batched"]}}, [labelled])
    np.testing.assert_array_equal(estimate.mean, np.vstack([labelled.measurement] * 2))


def messages(scans: Sequence[Scan]) -> Iterator[bytes]:
    hello = {
        "type": "hello",
        "version": 1,
        "identities": "known",
        "batch": 1,
        "sensors": [],
        "options": {"a": [1, "b"]},
    }
    for message in (hello, {"type": "start", "id": 1}, {"type": "start", "id": 2}):
        content = msgpack.packb(message)
        yield struct.pack("<I", len(content)) + content
    for scan in scans[:3]:
        yield from scan_frames([1, 2], [scan_of_member(scan, member) for member in range(2)])


@pytest.mark.slow
def test_damaged_frames_do_not_make_the_reader_read_beyond_them(folder: Path, scans: list[Scan]) -> None:
    compiled(folder, "tracker.c", *SANITIZED)
    whole = list(messages(scans))
    draw = random.Random(1)
    statuses, env = set(), {"ASAN_OPTIONS": "detect_leaks=0"}
    for _ in range(300):
        damaged = [bytearray(frame) for frame in whole]
        frame = damaged[draw.randrange(len(damaged))]
        for _ in range(draw.randint(1, 4)):
            frame[draw.randrange(4, len(frame))] = draw.choice([0, 0x7F, 0xC1, 0xDD, 0xDF, 0xFF, draw.randrange(256)])
        sent = b"".join(damaged)[: draw.choice([None, draw.randrange(10, 400)])]
        done = subprocess.run([folder / "tracker"], input=sent, env=env, capture_output=True, timeout=60)
        assert done.returncode in (0, 2), (done.stderr, sent)
        statuses.add(done.returncode)
    assert statuses == {0, 2}


def test_the_headers_say_the_versions_of_the_bench() -> None:
    from trackbench.driving import frames

    program = (LANGUAGES / "trackbench_program.h").read_text()
    assert f"#define TB_VERSION {frames.VERSION}\n" in program
    assert f"(1u << {frames.LARGEST.bit_length() - 1})" in program
