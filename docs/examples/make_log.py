"""Writes the log of a simulated drive, truth.csv, ego.csv and radar.csv, with two faults for `trackbench audit`.

The radar's time stamps are 80 ms late, and its mount is turned by 1.2 degrees.
"""

import pandas as pd

import trackbench as tb

DRIVE = """
name: drive
truth:
  source: scripted
  duration_s: 30
  rate_hz: 100
  observer: {x: 0, y: 0, yaw_deg: 20, vx_mps: 3, vy_mps: 1, turn_rate_degps: 4}
  objects:
    car:
      start: {x: 25, y: -6, speed_mps: 9, course_deg: 10}
      pieces: [{for_s: 6, acceleration_mps2: 1.2}, {for_s: 24, turn_rate_degps: 12}]
    cyclist:
      start: {x: 15, y: 12, speed_mps: 5, course_deg: -60}
      pieces: [{for_s: 10, turn_rate_degps: 25}, {for_s: 20, turn_rate_degps: -20}]
sensors:
  radar: {type: radar, rate_hz: 20, mount: {x_m: 2, yaw_deg: 1.2}, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5,
          range_rate_sigma_mps: 0.1, detection_probability: 0.8}
trackers:
  raw: {use: raw}
monte_carlo: {runs: 1}
"""
LATE_S = 0.08

truth = tb.truth(DRIVE)
ego, vx, vy = truth.observer, truth.vx, truth.vy
rows = [
    (truth.time[k], name, truth.px[k, i, 0], truth.py[k, i, 0], vx[k, i, 0], vy[k, i, 0])
    for k in range(0, len(truth.time), 10)
    for i, name in enumerate(truth.ids)
]
pd.DataFrame(rows, columns=["t", "name", "x", "y", "vx", "vy"]).to_csv("truth.csv", index=False)
pd.DataFrame({"t": truth.time, "x": ego.px, "y": ego.py, "yaw": ego.yaw}).to_csv("ego.csv", index=False)
rows = [
    (round(1e6 * (scan.time + LATE_S)), truth.ids[i], *scan.measurement[:, i, 0])
    for scan in tb.sense(DRIVE, runs=range(1))
    for i in range(len(truth.ids))
    if scan.valid[i, 0]
]
pd.DataFrame(rows, columns=["stamp_us", "name", "r", "phi", "doppler"]).to_csv("radar.csv", index=False)
