"""Alarms for trackers that know more than they measure: how often honest ones raise them, and what is found"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import trackbench as tb
from trackbench.base.types import Array
from trackbench.driving.law import COPIES, MOST, difference_in_law
from trackbench.metrics.built_in.basic import PositionOverReference
from trackbench.results.tracker_result import LEAST_OVER_BOUND

from .claim import Claim, power, rate

#: Repeats of a honest tracker, and of one that reads other members.
REPEATS, POWER = 2000, 200
INSTANTS, PERIOD, SIGMA, ACCELERATION = 60, 0.1, 0.3, 3.0
#: Runs of ``scripted/own_model`` that are cut into samples.
RUNS = 4200


def claims() -> Iterator[Claim]:
    """Honest trackers that draw random numbers are not said to read other members, whoever shares their draws; those
    that average over runs are. Filters that reach the bound are not said to beat it."""
    random = np.random.default_rng(5)
    for particles in (50, 100, 500):
        repeats = REPEATS if particles < 500 else REPEATS // 20
        for draws, shared in (("each member its own draws", False), ("all members the same draws", True)):
            hits = [_alarm(*_particle_errors(random, particles, shared)) for _ in range(repeats)]
            what = f"random trackers, {particles} particles, {draws}: said to read other members"
            yield rate(what, hits, 0.0, 0.001)
    for over, share in ((2, 1.0), (5, 1.0), (20, 1.0), (40, 1.0), (40, 0.3), (40, 0.1)):
        hits = [_alarm(*_averaged_errors(random, over, share)) for _ in range(POWER)]
        what = f"random trackers, {100 * share:g} % of the estimate a mean over {over} runs: said to read other members"
        yield power(what, hits, 0.99 if share == 1.0 else 0.0)
    yield from _bound()


def _bound() -> Iterator[Claim]:
    result = tb.run(tb.load("scripted/own_model", runs=RUNS, trackers=["kf_lidar", "ekf"]))
    table, metric = result.tables["runs"].to_pandas(), PositionOverReference()
    for name in ("kf_lidar", "ekf"):
        own = table[table.tracker == name]
        columns = np.array([own[column] for column in metric.columns])
        for runs in (2, 3, 5, 10, 100):
            samples = columns.reshape(3, -1, runs).transpose(1, 0, 2)
            intervals = [metric.of_runs(*sample) for sample in samples]
            hits = [
                item is not None and item.ci95 is not None and item.ci95[1] < LEAST_OVER_BOUND for item in intervals
            ]
            yield rate(f"scripted/own_model, {name}, {runs} runs: said to beat the bound", hits, 0.0, 0.025)


def _alarm(batch: Array, alone: Array) -> bool:
    return bool(difference_in_law(batch, alone))


def _particle_errors(random: np.random.Generator, particles: int, shared: bool) -> tuple[Array, Array]:
    """Mean log squared errors of a bootstrap particle filter, ``(MOST,)`` in a batch and ``(MOST, COPIES)`` alone;
    ``shared``: all members of a drive have the same draws."""
    measured = SIGMA * random.standard_normal((INSTANTS, MOST))
    drives = np.concatenate([np.zeros(MOST, dtype=int), np.repeat(np.arange(1, MOST + 1), COPIES)])
    member = np.concatenate([np.arange(MOST), np.repeat(np.arange(MOST), COPIES)])
    columns = drives if shared else np.arange(len(drives))

    def draws(*shape: int) -> Array:
        return random.standard_normal((*shape, columns.max() + 1))[..., columns]

    state = np.stack([measured[0][member] + SIGMA * draws(particles), 10 * draws(particles)])
    logs = np.zeros(len(drives))
    for z in measured[1:, member]:
        a = ACCELERATION * draws(particles)
        state = np.stack([state[0] + PERIOD * state[1] + PERIOD**2 / 2 * a, state[1] + PERIOD * a])
        weight = np.exp(-((z - state[0]) ** 2) / (2 * SIGMA**2)) + 1e-300
        sums = np.cumsum(weight / weight.sum(axis=0), axis=0)
        offset = random.random(columns.max() + 1)[columns]
        # Systematic resampling: particle i has those points (j + offset) / n that are in its part of the sums.
        last = np.clip(np.floor(sums * particles - offset) + 1, 0, particles).astype(int)
        last[-1] = particles
        starts = np.zeros((particles + 1, len(drives)), dtype=int)
        np.add.at(starts, (last[:-1], np.arange(len(drives))), 1)
        chosen = np.cumsum(starts[:particles], axis=0)
        state = np.take_along_axis(state, chosen[None], axis=1)
        # The target stands at 0 in the frame that moves with it.
        logs += np.log(state[0].mean(axis=0) ** 2) / (INSTANTS - 1)
    return logs[:MOST], logs[MOST:].reshape(MOST, COPIES)


def _averaged_errors(random: np.random.Generator, over: int, share: float) -> tuple[Array, Array]:
    """The same of measured positions of which a share is the mean over so many runs of the batch."""
    measured = random.standard_normal((2, INSTANTS, -(-MOST // over) * over))
    pooled = measured.reshape(2, INSTANTS, -1, over).mean(axis=-1, keepdims=True)
    batch = (1 - share) * measured + share * np.broadcast_to(pooled, (*pooled.shape[:3], over)).reshape(measured.shape)
    # It draws, but next to nothing.
    alone = measured[:, :, :MOST, None] + 1e-3 * random.standard_normal((2, INSTANTS, MOST, COPIES))
    batch_logs, alone_logs = (np.log((error**2).sum(axis=0)).mean(axis=0) for error in (batch, alone))
    return batch_logs[:MOST], alone_logs
