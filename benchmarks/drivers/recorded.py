"""Recorded traffic: how each vehicle moves along and across the road, at 10 Hz."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from trackbench.base.types import Array

FOLDER = Path(os.environ.get("TRACKBENCH_DATA", "../shared/data"), "recorded_traffic")
#: One window of a vehicle that stays in its lane: its speed, m/s, and its place across the road, m.
DT = 0.1
#: Samples of a window, as long as a vehicle of I-80 is recorded.
SAMPLES = 101
#: Vehicles further apart across the road are not in one lane, m.
SAME_LANE_M = 1.5


class Window(NamedTuple):
    """One vehicle for up to 10 s."""

    speed: Array
    """m/s."""
    side: Array | None
    """Place across the road, m; None where the vehicle changes lanes."""


def i80(part: int) -> list[Window]:
    """Every second vehicle of NGSIM I-80: ``part`` 0 for the fit, 1 to be held back."""
    with closing(sqlite3.connect(f"file:{FOLDER / 'i80.shf'}?mode=ro", uri=True)) as file:
        rows = file.execute(
            "select vehicle_id, speed, position_y, lane_id from Trajectory order by vehicle_id, sim_time"
        ).fetchall()
    table = np.array(rows, dtype=np.float64).reshape(-1, SAMPLES, 4)
    return [Window(v[:, 1], v[:, 2] if np.ptp(v[:, 3]) == 0 else None) for v in table[part::2]]


def us101() -> list[Window]:
    """The vehicles of the CommonRoad scenario of NGSIM US-101 that are there for 2.1 s at least."""
    vehicles = _us101()
    turned = np.exp(-1j * np.median([np.median(rows[:, 3]) for rows in vehicles]))
    windows = []
    for rows in vehicles:
        side = ((rows[:, 1] + 1j * rows[:, 2]) * turned).imag
        windows.append(Window(rows[:, 4], side if np.ptp(side) < SAME_LANE_M else None))
    return [window for window in windows if len(window.speed) >= 21]


def us101_gaps() -> Array:
    """Mean time gap of each vehicle of US-101 to that ahead, from bumper to bumper, s."""
    vehicles = _us101()
    turned = np.exp(-1j * np.median([np.median(rows[:, 3]) for rows in vehicles]))
    gaps: dict[int, list[float]] = {}
    for step in range(0, SAMPLES, 10):
        there = [(i, row) for i, rows in enumerate(vehicles) for row in rows[rows[:, 0] == step]]
        place = {i: (row[1] + 1j * row[2]) * turned for i, row in there}
        for i, row in there:
            ahead = [
                place[j].real - place[i].real - (row[5] + other[5]) / 2
                for j, other in there
                if abs(place[j].imag - place[i].imag) < SAME_LANE_M and place[j].real > place[i].real
            ]
            if ahead and row[4] > 2.0:
                gaps.setdefault(i, []).append(min(ahead) / row[4])
    return np.array([np.mean(each) for each in gaps.values()])


def _us101() -> list[Array]:
    """Of each vehicle ``(states, 6)``: step, x, y, m, heading, rad, speed, m/s, length, m."""
    root = ElementTree.parse(FOLDER / "USA_US101-5_1_T-1.xml").getroot()
    vehicles = []
    for vehicle in root.iter("dynamicObstacle"):
        length = float(vehicle.findtext("shape/rectangle/length", "nan"))
        states = [*vehicle.iter("initialState"), *vehicle.iter("state")]
        keys = ("time", "position/point/x", "position/point/y", "orientation", "velocity")
        rows = [
            [float(state.findtext(f"{key}/exact") or state.findtext(key, "nan")) for key in keys] for state in states
        ]
        vehicles.append(np.array([[*row, length] for row in rows]))
    return vehicles


def overlaps() -> int:
    """Pairs of vehicles of I-80 that are in one place at the middle of their windows.

    A road holds none: the windows of the vehicles are of different times.
    """
    with closing(sqlite3.connect(f"file:{FOLDER / 'i80.shf'}?mode=ro", uri=True)) as file:
        rows = file.execute(
            "select position_x, position_y, length from Trajectory join Vehicle on id = vehicle_id "
            "where abs(sim_time - (select avg(sim_time) from Trajectory)) < 0.01"
        ).fetchall()
    x, y, length = np.array(rows, dtype=np.float64).T
    touching = np.abs(x[:, None] - x) < (length[:, None] + length) / 2
    touching &= np.abs(y[:, None] - y) < 1.0
    return int((touching.sum() - len(x)) // 2)
