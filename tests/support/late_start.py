"""A scene in which an honest tracker starts a moment later than another, which does from the first measurement on."""

from pathlib import Path

SCENE = """
name: silence
truth:
  source: scripted
  duration_s: 10
  rate_hz: 20
  objects:
    crossing:
      start: {x: 20, y: 5, vx_mps: 8, vy_mps: 3}
      pieces: [{white: &walk {motion: cv, acceleration_sigma_mps2: 2}}]
    leaving: {start: {x: 30, y: -20, vx_mps: 12, vy_mps: -4}, pieces: [{white: *walk}]}
sensors:
  radar: {type: radar, rate_hz: 20, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1,
          detection_probability: 0.8}
  lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15, detection_probability: 0.8}
trackers:
  ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 2, initial: two_measurements}
  mine: {use: "alpha_beta:AlphaBeta", options: {alpha: 0.3}}
  broken: {filter: ekf, motion: cv, acceleration_sigma_mps2: 0.01, initial: {velocity: zero, velocity_sigma_mps: 0.1}}
monte_carlo: {runs: 20, seed: 3}
score: {settle_s: 0}
expect:
  - {tracker: ekf, metric: position_rmse, better_than: mine}
  - {tracker: ekf, metric: position_rmse, better_than: broken}
"""


#: Of fixed gains and a fixed covariance, which is far too large.
TRACKER = """
import numpy as np


class AlphaBeta:
    def __init__(self, alpha=0.25, beta=0.05):
        self.alpha, self.beta = alpha, beta

    def step(self, state, scan):
        if state is None:
            position, velocity, time = self.position(scan), np.zeros(2), scan.time
        else:
            position, velocity, time = state
            dt = scan.time - time
            position, time = position + dt * velocity, scan.time
            if scan.valid:
                innovation = self.position(scan) - position
                position = position + self.alpha * innovation
                velocity = velocity + self.beta / max(dt, 0.05) * innovation
        return (position, velocity, time), (np.concatenate([position, velocity]), np.diag([1.0, 1.0, 9.0, 9.0]))

    def position(self, scan):
        if scan.kind == "radar":
            distance, azimuth = scan.measurement[:2]
            x, y = distance * np.cos(azimuth), distance * np.sin(azimuth)
        else:
            x, y = scan.measurement
        sx, sy, yaw = scan.sensor_pose
        return np.array([sx + np.cos(yaw) * x - np.sin(yaw) * y, sy + np.sin(yaw) * x + np.cos(yaw) * y])
"""


def write_scene(folder: Path) -> Path:
    """The scene, and beside it the tracker."""
    (folder / "alpha_beta.py").write_text(TRACKER)
    (folder / "scene.yaml").write_text(SCENE)
    return folder / "scene.yaml"
