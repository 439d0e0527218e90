import csv
import json
from itertools import groupby

import numpy as np

with open("scans/manifest.json") as manifest:
    R = np.array(json.load(manifest)["sensors"]["lidar"]["noise_covariance"])
H, ENTRIES = np.eye(2, 4), [(a, b) for a in range(4) for b in range(a, 4)]
file = open("tracks.csv", "w", newline="")  # noqa: SIM115
out = csv.writer(file)
states = ["x_m", "y_m", "vx_mps", "vy_mps", *(f"p_{a}{b}" for a, b in ENTRIES)]
out.writerow(["scene", "run", "fingerprint", "time_s", "id", *states])
rows = csv.DictReader(open("scans/scans.csv"))  # noqa: SIM115
for run, of_run in groupby(rows, lambda row: (row["scene"], row["run"], row["fingerprint"])):
    tracks, before, created = [], 0.0, 0
    for _, scan in groupby(of_run, lambda row: row["scan"]):
        scan = list(scan)
        time, yaw = float(scan[0]["time_s"]), float(scan[0]["sensor_yaw_rad"])
        mount = np.array([float(scan[0]["sensor_x_m"]), float(scan[0]["sensor_y_m"])])
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        found = [mount + turn @ [float(row["x_m"]), float(row["y_m"])] for row in scan if row["valid"] == "1"]
        dt, before = time - before, time
        F, G = np.eye(4) + dt * np.eye(4, k=2), np.vstack([np.eye(2) * dt**2 / 2, np.eye(2) * dt])
        for track in tracks:
            x, P = F @ track["x"], F @ track["P"] @ F.T + 2.0**2 * G @ G.T
            S = H @ P @ H.T + R
            away = [(z - H @ x) @ np.linalg.solve(S, z - H @ x) for z in found]
            track["missed"] += 1
            if away and min(away) < 16:
                K, z = P @ H.T @ np.linalg.inv(S), found.pop(int(np.argmin(away)))
                x, P = x + K @ (z - H @ x), (np.eye(4) - K @ H) @ P @ (np.eye(4) - K @ H).T + K @ R @ K.T
                track["hits"], track["missed"] = track["hits"] + 1, 0
            track["x"], track["P"] = x, P
            if track["hits"] > 3:
                out.writerow([*run, time, track["id"], *x, *(P[a, b] for a, b in ENTRIES)])
        tracks = [track for track in tracks if track["missed"] < (5 if track["hits"] > 3 else 2)]
        for z in found:
            created += 1
            P = np.diag([R[0, 0], R[1, 1], 400.0, 400.0])
            tracks.append({"id": created, "x": np.array([*z, 0, 0]), "P": P, "hits": 1, "missed": 0})
