"""highway-env for an agent that sees what a car would know: the tracks of a tracker instead of the truth.

python agent_sees_tracks.py drives one episode by a rule.
"""

import gymnasium
import numpy as np

import trackbench as tb
from trackbench.trackers.multi import build_multi

# Of each column of an observation: presence; x, y, m; vx, vy, m/s; standard deviations of x and y, m.
LIMITS = np.array([1, 200, 200, 100, 100, 10, 10], dtype=np.float32)


class TracksEnv(gymnasium.Env):
    """Actions, rewards and ends of highway-env; the observation is made of tracks.

    Row 0 of an observation is the ego vehicle at x = 0, with its own y and velocity. The others are the nearest
    tracks, relative to it in position and velocity; a row without a track is 0. x points ahead, y to the left.

    Args:
        scenario: name, file or mapping of a scenario with hidden identities and highway-env.
        tracker: name of one of its built-in trackers.
        rows: of an observation.
        changes: keys of the scenario and their values.
    """

    def __init__(self, scenario="traffic/dense_highway", tracker="gnn", rows=8, changes=None):
        self._scenario, self._changes = scenario, changes or {}
        loaded = tb.load(scenario, self._changes)
        self._tracker = build_multi(loaded.config.trackers[tracker])
        self.action_space = tb.live(loaded).action_space
        high = np.tile(LIMITS, (rows, 1))
        self.observation_space = gymnasium.spaces.Box(-high, high, dtype=np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        own = int(self.np_random.integers(2**31))
        scenario = tb.load(self._scenario, {**self._changes, "truth.seed": own, "truth.seeds": 1}, seed=own)
        self._live, self._state, self._last = tb.live(scenario), None, None
        return self._observe(self._live.latest), {}

    def step(self, action):
        latest = self._live.step(action)
        return self._observe(latest), latest.reward, latest.terminated, latest.truncated, {}

    @property
    def truth(self):
        """Motion of all vehicles, to judge an episode by; the agent does not see it."""
        return self._live.latest.truth

    def _observe(self, latest):
        observation = np.zeros(self.observation_space.shape)
        ego = latest.truth.observer
        own = np.array([ego.px[-1], ego.py[-1], ego.vx[-1], ego.vy[-1]])
        observation[0, :5] = [1, 0, *own[1:]]
        tracks = self._tracks(latest.scans, latest.truth.time[-1])
        if tracks is not None:
            relative = tracks.mean - own[:, None]
            nearest = np.argsort(np.hypot(*relative[:2]))[: len(observation) - 1]
            rows = observation[1 : 1 + len(nearest)]
            rows[:, 0], rows[:, 1:5] = 1, relative[:, nearest].T
            rows[:, 5:] = np.sqrt(tracks.covariance[[0, 1], [0, 1]][:, nearest]).T
        return np.clip(observation, -LIMITS, LIMITS).astype(np.float32)

    def _tracks(self, scans, now):
        for scan in scans:
            self._state, _ = self._tracker.step(self._state, scan)
            self._last = scan
        if self._last is None:
            return None
        # A scan without detections asks for the tracks of now; the latest one may have been taken earlier.
        nothing = {"measurement": self._last.measurement[:, :0], "valid": self._last.valid[:0]}
        asked = self._last._replace(time=now, arrival_time=now, asked=True, **nothing)
        return self._tracker.step(self._state, asked)[1]


def keep_a_gap(observation):
    """Action for highway-env: slow down behind a track in the own lane, else go faster."""
    _, x, y, vx = observation[1:, :4].T
    in_the_way = (x > 0) & (x < 15 + 1.5 * observation[0, 3] - 2 * vx) & (np.abs(y) < 2)
    return 4 if in_the_way.any() else 3


if __name__ == "__main__":
    env = TracksEnv(changes={"truth.config.vehicles_density": 1})
    observation, _ = env.reset(seed=1)
    total, ended = 0.0, False
    while not ended:
        observation, reward, terminated, truncated, _ = env.step(keep_a_gap(observation))
        total, ended = total + reward, terminated or truncated
    print(f"{env.truth.time[-1]:.0f} s, reward {total:.1f}, {'collision' if terminated else 'no collision'}")
