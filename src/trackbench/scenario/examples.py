"""Examples for the reference of the scenario file."""

#: An example of each section; together they are a whole scenario.
EXAMPLES = {
    "scenario": """\
name: highway_overtake
description: Radar and lidar behind a car that overtakes.
""",
    "truth": """\
truth:
  source: highway-env
  env: highway-v0
  config: {lanes_count: 3, vehicles_count: 12}
  seed: 1
  duration_s: 20
  rate_hz: 20
  observer: ego
  targets: {nearest: 4}
""",
    "sensors": """\
sensors:
  front_radar:
    type: radar
    rate_hz: 20
    mount: {x_m: 2.5}
    fov_deg: 120
    max_range_m: 150
    detection_probability: 0.95
    range_sigma_m: 0.3
    azimuth_sigma_deg: 0.5
    range_rate_sigma_mps: 0.1
    dropouts:
      - {from_s: 8, to_s: 10}
  roof_lidar:
    type: lidar
    preset: velodyne_vlp16
    position_sigma_m: 0.15   # a key that is written wins over the preset
""",
    "sensing": """\
sensing: {identities: known}
""",
    "trackers": """\
trackers:
  raw: {use: raw}
  ekf_cv:
    filter: ekf
    motion: cv
    acceleration_sigma_mps2: 3
    sensors: [front_radar, roof_lidar]
  ukf_ctrv:
    filter: ukf
    motion: ctrv
    acceleration_sigma_mps2: 2
    yaw_acceleration_sigma_radps2: 0.5
    initial: {from: first_measurement, velocity_sigma_mps: 20}
  ukf_cv:
    filter: ukf
    motion: cv
    sweep: {acceleration_sigma_mps2: [1, 3]}   # ukf_cv_1 and ukf_cv_3
""",
    "monte_carlo": """\
monte_carlo: {runs: 100, seed: 7}
""",
    "score": """\
score:
  settle_s: 2
  divergence_m: 20
""",
    "expect": """\
expect:
  - {tracker: ekf_cv, metric: position_rmse, below: 1.0}
  - {tracker: ekf_cv, metric: nis.front_radar.inside95, above: 0.9}
  - {tracker: ukf_ctrv, metric: nees.verdict, is: consistent}
  - {tracker: ukf_ctrv, metric: position_rmse, better_than: raw}
""",
    "recording": """\
recording: {run: 0}
""",
}

#: An example of each other form that a section can have, by the class that describes it.
OTHER_EXAMPLES = {
    "Clutter": """\
sensing: {identities: hidden}
sensors:
  front_radar:
    type: radar
    rate_hz: 20
    range_sigma_m: 0.3
    azimuth_sigma_deg: 0.5
    range_rate_sigma_mps: 0.1
    fov_deg: 120
    max_range_m: 150
    detection_probability: 0.95
    detection: {half_range_m: 140, by_aspect: [[0, 1], [90, 0.6], [180, 1]]}
    occlusion: true
    resolution: {range_m: 2, azimuth_deg: 4, range_rate_mps: 1.5}
    clutter:
      per_scan: 10
      range_rate_mps: [-60, 40]
      places: [{frame: observer, line: [[5, 6], [130, 6]], per_scan: 3, spread_m: 0.3}]   # a guard rail
    states: {detection_probability: 0.9, clutter_per_scan: 5}
""",
    "ImmConfig": """\
trackers:
  imm:
    filter: ekf
    motion:
      imm:
        - {model: cv, acceleration_sigma_mps2: 0.5}
        - {model: ctrv, acceleration_sigma_mps2: 3, yaw_acceleration_sigma_radps2: 0.5}
      stay_s: [10, 5]
""",
    "ScriptedTruth": """\
truth:
  source: scripted
  duration_s: 20
  rate_hz: 20
  observer: {x: 0, y: 0, yaw_deg: 0}
  objects:
    cyclist:
      start: {x: 5, y: 0, speed_mps: 5, course_deg: 90}
      length_m: 1.8
      width_m: 0.6
      pieces:
        - {for_s: 5}
        - {for_s: 3, turn_rate_degps: 30, acceleration_mps2: 0.5}
        - {for_s: 5, white: {motion: cv, acceleration_sigma_mps2: 3}}   # drawn anew in each run
        - {for_s: 2, white_acceleration: {x_sigma_mps2: 5, y_sigma_mps2: 0}}
        - {waypoints: [[0, 0], [10, 5]], speed_mps: 5}
    bollard:
      start: {x: 20, y: 3}
""",
    "RecordingTruth": """\
truth:
  source: recording
  format: csv
  path: $TRACKBENCH_DATA/drive.csv   # time,name,x,y,v_east,v_north,r,phi,doppler
  columns: {time: time, object: name, px: x, py: y, vx: v_east, vy: v_north}
  units: {time: ms, angle: deg}
  observer: {x: 10, y: 0, yaw_deg: 90}
  readings:
    front_radar: {range: r, azimuth: phi, range_rate: doppler}
""",
}
