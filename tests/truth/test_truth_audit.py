"""The audit on motion that is known exactly."""

from dataclasses import replace

import numpy as np
import pytest

from trackbench.base.errors import InputError
from trackbench.base.types import Observer, Truth
from trackbench.truth.audit import TOLERANCE_MPS, audited_truth

DT = 0.05


def circling(steps: int = 100, objects: int = 2, *, trapezoid: bool = False) -> Truth:
    """Vehicles on a circle, with the velocity that Euler's rule needs, or with the exact one."""
    time = np.arange(steps) * DT
    angle = 0.5 * time[:, None, None] + np.arange(objects)[None, :, None]
    px, py = 30.0 * np.cos(angle), 30.0 * np.sin(angle)
    vx, vy = (np.diff(p, axis=0, append=2 * p[-1:] - p[-2:-1]) / DT for p in (px, py))
    if trapezoid:
        vx, vy = -15.0 * np.sin(angle), 15.0 * np.cos(angle)
    zero = np.zeros(steps)
    return Truth(
        time=time,
        ids=tuple(f"v{i + 1}" for i in range(objects)),
        px=px,
        py=py,
        heading=angle + np.pi / 2,
        course=np.arctan2(vy, vx),
        speed=np.hypot(vx, vy),
        acceleration=np.zeros_like(px),
        yaw_rate=np.full_like(px, 0.5),
        alive=np.ones((steps, objects), dtype=bool),
        length=np.full(objects, 5.0),
        width=np.full(objects, 2.0),
        observer=Observer(zero, zero, zero, zero, zero, zero),
    )


@pytest.mark.parametrize("trapezoid", [False, True])
def test_consistent_truth_passes_untouched(trapezoid: bool) -> None:
    truth = circling(trapezoid=trapezoid)
    audited = audited_truth(truth, "refuse")
    assert audited.audit["verdict"] == "consistent"
    assert audited.audit["velocity_error_after"]["max_mps"] < TOLERANCE_MPS
    np.testing.assert_array_equal(audited.course, truth.course)
    assert audited.alive.all()


def test_velocity_wrong_in_a_stretch_is_taken_from_the_displacement() -> None:
    right = circling()
    course = right.course.copy()
    course[40:60, 1] += 0.2
    audited = audited_truth(replace(right, course=course), "repair")
    assert audited.audit["repaired"]["velocity_from_displacement"] == ["v2"]
    assert audited.audit["jumps"] == []
    assert audited.audit["velocity_error_before"]["max_mps"] > 2.0
    np.testing.assert_allclose(audited.vx[:-1], right.vx[:-1], atol=1e-9)
    np.testing.assert_allclose(audited.vy[:-1], right.vy[:-1], atol=1e-9)
    assert audited.alive.all()
    with pytest.raises(InputError, match=r"contradicts the motion, by up to 3 m/s \(v2 at .*audit: repair"):
        audited_truth(replace(right, course=course), "refuse")


def test_track_is_cut_where_its_body_jumps() -> None:
    truth = circling()
    px = truth.px.copy()
    px[50:, 0] += 0.4
    audited = audited_truth(replace(truth, px=px), "repair")
    (jump,) = audited.audit["jumps"]
    assert (jump["object"], jump["time_s"], jump["distance_m"]) == ("v1", pytest.approx(2.5), pytest.approx(0.4))
    assert audited.audit["repaired"]["cut_at_jump"] == ["v1"]
    np.testing.assert_array_equal(audited.alive[:, 0], np.arange(100) < 50)
    assert audited.alive[:, 1].all()
    assert audited.audit["velocity_error_after"]["max_mps"] < 1e-9
    with pytest.raises(InputError, match=r"v1 jumps by 0\.4 m at 2\.50 s"):
        audited_truth(replace(truth, px=px), "refuse")


def test_track_is_cut_at_a_collision_even_if_nothing_jumps() -> None:
    truth = circling()
    collided = np.zeros_like(truth.alive)
    collided[70:, 1] = True
    audited = audited_truth(truth, "repair", collided=(collided, np.zeros(len(truth.time), dtype=bool)))
    np.testing.assert_array_equal(audited.alive[:, 1], np.arange(100) < 70)
    assert audited.audit["verdict"] == "repaired"


def test_wreck_that_stood_there_from_the_start_stays() -> None:
    truth = circling()
    collided = np.zeros_like(truth.alive)
    collided[:, 1] = True
    assert audited_truth(truth, "refuse", collided=(collided, collided[:, 0])).alive.all()


def test_truth_ends_where_the_observer_jumps() -> None:
    truth = circling()
    px = truth.observer.px.copy()
    px[30:] = 1.5
    audited = audited_truth(replace(truth, observer=replace(truth.observer, px=px)), "repair")
    assert len(audited.time) == len(audited.px) == len(audited.alive) == len(audited.observer.px) == 30
    assert audited.audit["ended_early"] == {
        "time_s": pytest.approx(1.45),
        "reason": "the observer collides or jumps",
    }
    assert audited.audit["jumps"][0]["object"] == "observer"


def test_absent_steps_are_not_judged() -> None:
    truth = circling()
    alive = truth.alive.copy()
    alive[:20, 0] = alive[80:, 0] = False
    px = truth.px.copy()
    px[:20, 0], px[80:, 0] = px[20, 0], px[79, 0]
    assert audited_truth(replace(truth, px=px, alive=alive), "refuse").audit["verdict"] == "consistent"
