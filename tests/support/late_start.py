"""A scene in which an honest tracker starts a moment later than another: README's, from the first measurement on."""

from pathlib import Path

from tests.support.places import ROOT

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


def write_scene(folder: Path) -> Path:
    """The scene, and beside it the tracker of the README."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    code = next(code for code in readme.split("```python")[1:] if "class AlphaBeta" in code).split("```")[0]
    (folder / "alpha_beta.py").write_text(code)
    (folder / "scene.yaml").write_text(SCENE)
    return folder / "scene.yaml"
