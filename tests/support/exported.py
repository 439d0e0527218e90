"""A scenario whose scans are exported: few detections, late scans, and one of hidden identities with clutter."""

from __future__ import annotations

SCENARIO = """\
name: exported
truth:
  source: scripted
  duration_s: 2
  rate_hz: 10
  observer: {x: 1, y: 2, yaw_deg: 30, vx_mps: 3, vy_mps: 1, turn_rate_degps: 4}
  objects:
    car: {start: {x: 25, y: -6, speed_mps: 9, course_deg: 10}, pieces: [{for_s: 2, turn_rate_degps: 12}]}
    cyclist: {start: {x: 15, y: 12, speed_mps: 5, course_deg: -60}, pieces: [{for_s: 2}]}
sensors:
  radar: {type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1,
          max_range_m: 60, detection_probability: 0.5, latency_s: [0, 0.25]}
  lidar: {type: lidar, rate_hz: 5, position_sigma_m: 0.15, detection_probability: 0.3}
trackers:
  raw: {use: raw}
monte_carlo: {runs: 3, seed: 7}
"""
HIDDEN = SCENARIO.replace("trackers:", "sensing: {identities: hidden}\ntrackers:").replace(
    "{use: raw}", "{filter: ekf, motion: cv, acceleration_sigma_mps2: 3, associate: {method: gnn}}"
)
HIDDEN = HIDDEN.replace("latency_s", "clutter: {per_scan: 0.5}, latency_s")
