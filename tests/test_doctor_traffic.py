"""The doctor of trackers of several objects: every fault by its name, and sound trackers without any."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from trackbench.cli.commands import cli
from trackbench.doctor.findings import faults_of
from trackbench.doctor.subject import SENSORS, subject
from trackbench.doctor.traffic.examine import TrafficDoctor
from trackbench.doctor.traffic.ranking import CONSEQUENCES
from trackbench.errors import InputError
from trackbench.multi import build_multi
from trackbench.stepping.tracks import BatchedTracks, LoopedTracks, TracksStepper
from trackbench.trackers.config import FilterConfig
from trackbench.types import Scan, Tracks

Make = Callable[[], TracksStepper]
#: A sensor's own figures, under the name that the doctor's scans have.
LOW, HIGH = 1e-9, 1e-2
ALL = ("gnn", "jpda", "jipda", "pmb")
COUNTING, EXISTENCE = ALL[:2], ALL[2:]


def config(method: str, filter: str = "ekf", **associate: Any) -> FilterConfig:
    more = {"motion": "cv"} if filter == "ekf" else {"motion": "ctrv", "yaw_acceleration_sigma_radps2": 1.0}
    return FilterConfig.model_validate(
        {"filter": filter, "acceleration_sigma_mps2": 3.0, "associate": {"method": method, **associate}, **more}
    )


def built(found: FilterConfig) -> Make:
    return lambda: BatchedTracks(build_multi(found))


class Changed:
    """A sound tracker whose answers are changed."""

    def __init__(self, method: str) -> None:
        self.tracker = build_multi(config(method))

    def step(self, state: Any, scan: Scan) -> tuple[Any, Tracks]:
        state, tracks = self.tracker.step(state, scan)
        return state, self.change(tracks)

    def change(self, tracks: Tracks) -> Tracks:
        raise NotImplementedError


class Twice(Changed):
    def change(self, tracks: Tracks) -> Tracks:
        both = Tracks(*(None if part is None else np.concatenate([part, part], axis=-1) for part in tracks))  # type: ignore[arg-type]
        return both._replace(ids=np.concatenate([2 * tracks.ids, 2 * tracks.ids + 1]))


class Renumbered(Changed):
    def change(self, tracks: Tracks) -> Tracks:
        return tracks._replace(ids=np.arange(len(tracks.ids)))


class Returning(Changed):
    """Returns early at an empty scan."""

    def step(self, state: Any, scan: Scan) -> tuple[Any, Tracks]:
        inner, last = state or (None, None)
        if not len(scan.valid) and last is not None:
            return state, last._replace(used=np.full(len(last.ids), -1))
        inner, tracks = self.tracker.step(inner, scan)
        return (inner, tracks), tracks


class NearestInPlane:
    """Each track of a sound tracker also jumps to the nearest detection, however far it is."""

    def __init__(self) -> None:
        self.tracker = build_multi(config("gnn"))

    def step(self, state: Any, scan: Scan) -> tuple[Any, Tracks]:
        state, tracks = self.tracker.step(state, scan)
        if len(scan.valid) and len(tracks.ids):
            z = scan.measurement
            x, y = (z[0] * np.cos(z[1]), z[0] * np.sin(z[1])) if scan.kind == "radar" else z[:2]
            nearest = np.argmin(np.hypot(tracks.mean[0][:, None] - x, tracks.mean[1][:, None] - y), axis=1)
            mean = tracks.mean.copy()
            mean[:2] = [x[nearest], y[nearest]]
            tracks = tracks._replace(mean=mean, used=nearest)
        return state, tracks


def looped(make: Callable[[], Any]) -> Make:
    return lambda: LoopedTracks(make, 1)


def own(sensor: str, key: str, value: float) -> dict[str, Any]:
    return {key: {sensor: value}}


def mutants(sensor: str) -> dict[str, tuple[str, Make]]:
    found: dict[str, tuple[str, Make]] = {}

    def add(fault: str, name: str, make: Make) -> None:
        found[f"{fault} {name}"] = (fault, make)

    for method in ALL:
        for gate in (0.3, 0.6):
            add("gate_too_small", f"{method} {gate}", built(config(method, gate=gate)))
        for fault, kind in (
            ("double_tracks", Twice),
            ("ids_reused", Renumbered),
            ("empty_scan_not_predicted", Returning),
        ):
            add(fault, method, looped(lambda kind=kind, method=method: kind(method)))
    for method in COUNTING:
        add("confirms_too_soon", method, built(config(method, confirm=[1, 1])))
        add("confirms_too_late", method, built(config(method, confirm=[30, 40])))
        add("never_deletes", method, built(config(method, delete_after_s=1000)))
    for method in EXISTENCE:
        add("confirms_too_soon", method, built(config(method, confirm_existence=0.01)))
        add("confirms_too_late", method, built(config(method, confirm_existence=1 - 1e-15)))
        for value in (0.5, 0.999):
            misstated = own(sensor, "detection_probability", value)
            add("pd_misstated", f"{method} {value}", built(config(method, **misstated)))
        for value in (LOW, HIGH):
            add(
                "clutter_misstated", f"{method} {value}", built(config(method, **own(sensor, "clutter_density", value)))
            )
    add("order_dependent", "naive", built(config("naive")))
    add("gate_too_large", "nearest", looped(NearestInPlane))
    return found


SOUND: dict[str, Make] = {
    **{method: built(config(method)) for method in ALL},
    "by score": built(config("gnn", confirm="score")),
    "ukf gnn": built(config("gnn", "ukf")),
    "ukf pmb": built(config("pmb", "ukf")),
    "wide gate": built(config("jipda", gate=0.999999)),
    "narrow gate": built(config("gnn", gate=0.99)),
    "quick": built(config("gnn", confirm=[2, 3])),
    "slow": built(config("gnn", confirm=[4, 6])),
    "patient": built(config("gnn", delete_after_s=2)),
}


def first_fault(sensor: str, make: Make) -> str:
    findings = TrafficDoctor({sensor: SENSORS[sensor]}).examine("tracker", make).findings
    return findings[0].fault if findings else ""


@pytest.mark.parametrize("sensor", ["radar", "lidar"])
@pytest.mark.parametrize("method", ["gnn", "pmb"])
def test_a_sound_tracker_has_no_fault(sensor: str, method: str) -> None:
    assert first_fault(sensor, SOUND[method]) == ""


@pytest.mark.slow
@pytest.mark.parametrize("sensor", ["radar", "lidar"])
@pytest.mark.parametrize("name", SOUND)
def test_no_sound_tracker_has_a_fault(sensor: str, name: str) -> None:
    assert first_fault(sensor, SOUND[name]) == ""


@pytest.mark.slow
def test_nine_of_ten_faults_are_named_first() -> None:
    outcomes = {
        f"{sensor} {name}": (fault, first_fault(sensor, make))
        for sensor in ("radar", "lidar")
        for name, (fault, make) in mutants(sensor).items()
    }
    wrong = {name: found for name, (fault, found) in outcomes.items() if found != fault}
    assert len(wrong) <= 0.1 * len(outcomes), wrong
    # Every fault has its name at least once.
    assert {fault for fault, found in outcomes.values() if fault == found} == set(
        faults_of("trackbench.doctor.traffic")
    )


def test_a_tracker_of_a_scenario_and_a_class_are_examined(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.py").write_text(
        "import numpy as np\nfrom trackbench.types import Tracks\n\n\nclass Silent:\n"
        "    def step(self, state, scan):\n        return state, None\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    for arguments, fault in (
        (["traffic/dense_highway#naive"], "order_dependent"),
        (["mine:Silent", "--identities", "hidden", "--in-process"], "confirms_too_late"),
    ):
        done = CliRunner().invoke(cli, ["doctor", *arguments, "--json", "--out", str(tmp_path / "out")])
        assert done.exit_code == 1, done.output
        assert json.loads(done.stdout)["findings"][0]["fault"] == fault
    assert (tmp_path / "out" / "report.html").exists()


def test_the_oracle_is_not_examined() -> None:
    with pytest.raises(InputError, match="told the true origins"):
        subject("traffic/dense_highway#oracle", {})


def test_causes_and_consequences_are_known_faults() -> None:
    known = set(faults_of("trackbench.doctor.traffic"))
    assert set(CONSEQUENCES) | {fault for faults in CONSEQUENCES.values() for fault in faults} <= known
