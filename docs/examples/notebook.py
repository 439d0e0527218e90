# %% [markdown]
# # Which EKF for motorway traffic?
# A shipped scenario, run twice: metrics, figures, two tunings compared, and what the trackers are given.

# %%
import matplotlib.pyplot as plt
import numpy as np

import trackbench as tb

scenario = tb.load("highway", runs=50, trackers=["raw", "kf_cv", "ekf_cv"])
result = tb.run(scenario)
result

# %% [markdown]
# ## Metrics
# Each has a value, a unit and a 95 % interval.

# %%
for tracker in result.scored:
    low, high = tracker.position_rmse.ci95
    print(f"{tracker.name}: {tracker.position_rmse.value:.3f} m ({low:.3f} to {high:.3f}), {tracker.nees.verdict}")

# %% [markdown]
# ## Figures
# Those of the report, and one of our own from a table.

# %%
result.figure("errors")

# %%
steps = result.to_pandas("steps")
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.set(xlabel="time, s", ylabel="velocity RMSE, m/s")
for name, rows in steps[steps["tracker"] != "raw"].groupby("tracker", observed=True):
    axes.plot(rows["time_s"], rows["velocity_rmse_mps"], label=name)
axes.legend()
figure.savefig("velocity.svg")

# %% [markdown]
# ## Two tunings
# Is the EKF better if it is told of harder manoeuvres? On the same measurements, the difference is taken run by run.

# %%
agile = tb.run(tb.load("highway", {"trackers.ekf_cv.acceleration_sigma_mps2": 6}, runs=50, trackers=["ekf_cv"]))
compared = tb.compare(result, agile, trackers=["ekf_cv"])
compared

# %%
difference = compared.differences[0]
print(f"{difference.percent:+.1f} %: {difference.verdict}, paired over {difference.paired_runs} runs")

# %% [markdown]
# ## A tracker of our own
# The class of a cell, beside the others: the mean of the last two lidar positions.


# %%
class MeanOfTwo:
    def step(self, state, scan):
        if scan.kind != "lidar" or not scan.valid:
            return state, None
        x, y, yaw = scan.sensor_pose
        seen_x, seen_y = scan.measurement
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        here = [x, y] + turn @ [seen_x, seen_y]
        position = here if state is None else (here + state) / 2
        return here, (np.array([*position, 0, 0]), np.diag([1, 1, 400, 400]))


own = tb.run(tb.load("highway", {"trackers.mine": {"use": MeanOfTwo}}, runs=5, trackers=["raw", "mine"]))
own.to_pandas().query("metric == 'position_rmse' and condition == ''")

# %% [markdown]
# ## Truth and scans
# What the trackers are held against, and what they get: here the error of the lidar's positions in run 0.

# %%
truth = tb.truth(scenario)
scans = tb.sense(scenario, runs=range(1))
print(f"{len(truth.ids)} vehicles over {truth.time[-1]:.0f} s, {len(scans)} scans")

# %%
errors = []
for scan in scans:
    if scan.kind == "lidar":
        step = np.argmin(abs(truth.time - scan.time))
        x, y, yaw = scan.sensor_pose
        seen_x, seen_y = scan.measurement[..., 0]
        px = x + np.cos(yaw) * seen_x - np.sin(yaw) * seen_y
        py = y + np.sin(yaw) * seen_x + np.cos(yaw) * seen_y
        errors.append(np.stack([px - truth.px[step, :, 0], py - truth.py[step, :, 0]])[:, scan.valid[:, 0]])
print("lidar sigma, m:", np.concatenate(errors, axis=1).std(axis=1).round(3))
