"""A truth source: cars that weave from side to side."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydantic import Field

from trackbench.base.config import Positive
from trackbench.base.types import Observer, Progress, Truth, no_progress
from trackbench.truth import Draw, LoadedTruth, SteppedTruth


class Weave(SteppedTruth):
    """Cars that go along x and weave from side to side, exact in position and velocity."""

    cars: int = Field(2, ge=1, le=20, description="How many there are, 5 m apart.")
    speed_mps: Positive = Field(15, description="Speed along x, m/s.")
    amplitude_m: Positive = Field(2, description="How far they go to either side, m.")
    period_s: Positive = Field(8, description="Time from one side and back, s.")

    def load(
        self,
        draw: Draw,
        *,
        folder: Path,
        sensors: Mapping[str, str] | None = None,
        cache: bool = True,
        progress: Progress = no_progress,
    ) -> LoadedTruth:
        time = np.arange(round(self.duration_s * self.rate_hz) + 1) / self.rate_hz
        w, t = 2 * np.pi / self.period_s, time[:, None, None]
        shape = (len(time), self.cars, 1)
        phase = np.arange(self.cars)[:, None]
        px = np.broadcast_to(20 + self.speed_mps * t, shape)
        py = 5.0 * phase + self.amplitude_m * np.sin(w * t + phase)
        vx, vy = np.broadcast_to(self.speed_mps, shape), self.amplitude_m * w * np.cos(w * t + phase)
        ay = -self.amplitude_m * w**2 * np.sin(w * t + phase)
        speed, course = np.hypot(vx, vy), np.arctan2(vy, vx)
        still = np.zeros_like(time)
        truth = Truth(
            time=time,
            ids=tuple(f"car{i + 1}" for i in range(self.cars)),
            px=px,
            py=py,
            heading=course,
            course=course,
            speed=speed,
            acceleration=vy * ay / speed,
            yaw_rate=vx * ay / speed**2,
            alive=np.ones(shape[:2], dtype=bool),
            length=np.full(self.cars, 4.5),
            width=np.full(self.cars, 1.8),
            observer=Observer(still, still, still, still, still, still),
            source=self.model_dump(mode="json"),
        )
        return LoadedTruth(truth)
