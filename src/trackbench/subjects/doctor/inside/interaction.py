"""The steps of an interacting multiple model filter, held against its equations.

Blom and Bar-Shalom, The interacting multiple model algorithm, IEEE TAC 33, 1988; Bar-Shalom, Li and Kirubarajan 2001,
section 11.6.6. With the transition probabilities ``pi_ij`` from model i to model j and the probabilities ``mu_i``:
``c_j = sum_i pi_ij mu_i`` and the weights ``w_ij = pi_ij mu_i / c_j``. Each model starts from the mixture with its
weights, and ``mu_j`` becomes ``c_j L_j``, normalised, with the likelihood ``L_j = N(y_j; 0, S_j)`` of its innovation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Scan
from trackbench.base.units import difference
from trackbench.driving.drive import empty_scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.inside.bank import (
    Models,
    ModelWays,
    families,
    found_models,
    of_module,
    stationary,
    transition_matrices,
    with_rows,
)
from trackbench.subjects.doctor.inside.values import Assigned, Held, Pool, held_values, traced
from trackbench.subjects.doctor.probes import with_measurement_noise
from trackbench.subjects.doctor.session import TrackerSession
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: How many of the last scans are looked into, and after which scan the constants are compared with those before them.
LOOKED, EARLY = 8, 3
#: Standard deviations of the innovation that is given.
INNOVATION = 1.5
#: Time of an instant, s, and by how much a prediction over it changes a mean, in standard deviations, or a covariance,
#: relative to it, at most.
INSTANT, INSTANTLY = 1e-9, 1e-6
#: Probability of a model below which it says nothing.
IMPROBABLE = 0.02


@dataclass(frozen=True, eq=False)
class Bank:
    """The models of a tracker."""

    held: Held
    """The transition probabilities, as the tracker holds them."""
    transition: Array
    """``(m, m)`` the same, with a row for the model before."""
    ways: ModelWays
    fits: bool
    """Whether the covariance that is returned is that of the mixture."""


class ModelInnovation(NamedTuple):
    """Of one model at a measurement."""

    value: Array
    """``(z,)``"""
    covariance: Array
    """``(z, z)``"""
    noise: Array
    """``(z, z)`` that of the measurement."""
    updated: Array
    """``(z,)`` the innovation after the update."""


class BankStep:
    """One step with a measurement, and what the equations say of it.

    Args:
        bank: the models.
        scan: of the step.
        before: the models after the scan before.
        started: at a missed scan an instant later.
        predicted: at a missed scan at the time of this one.
        after: the models after this scan.
        assigned: what the lines of the step assign.
    """

    def __init__(
        self,
        bank: Bank,
        scan: Scan,
        before: Models,
        started: Models,
        predicted: Models,
        after: Models,
        assigned: Sequence[Assigned],
    ) -> None:
        self.bank, self.scan = bank, scan
        self.before, self.started, self.predicted, self.after = before, started, predicted, after
        self.assigned = assigned

    @cached_property
    def pool(self) -> Pool:
        """All numbers of the step."""
        return Pool(entry.value for entry in self.assigned)

    @cached_property
    def transition(self) -> Array:
        """``(m, m)`` transition probabilities: those held, or those that the step makes of them for its time.

        The first by which the models start from their mixtures, or by whose transpose they do.
        """
        made = (with_rows(entry.value) for entry in self.assigned if entry.value.size == self.bank.transition.size)
        possible = [self.bank.transition, *(matrix for matrix in made if matrix is not None)]
        ways = [*((matrix, matrix) for matrix in possible), *((matrix, matrix.T) for matrix in possible)]
        fitting = (matrix for matrix, used in ways if self.starts_from(self.mixed(used)[0]))
        return next(fitting, self.bank.transition)

    def prior(self, transition: Array) -> Array:
        """``(m,)`` probabilities after a transition."""
        return transition.T @ self.before.probability

    def mixed(self, transition: Array) -> tuple[Array, Array]:
        """``(m, n)``, ``(m, n, n)`` from which the models start."""
        joint = transition * self.before.probability[:, None]
        both = [self.before.mixed(weights) for weights in (joint / joint.sum(axis=0)).T]
        return np.stack([mean for mean, _ in both]), np.stack([covariance for _, covariance in both])

    def starts_from(self, mean: Array, covariance: Array | None = None) -> bool:
        """Whether the models start from some means and covariances: they are there after an instant, or computed."""
        sigma = np.sqrt(np.einsum("jaa->ja", self.before.covariance))
        near = np.abs(self.started.mean - mean).max(where=sigma > 0.0, initial=0.0) < INSTANTLY * sigma.max()
        if covariance is None:
            return bool(near) or self.pool.has(mean)
        gap = np.abs(self.started.covariance - covariance).max()
        return bool(gap < INSTANTLY * np.abs(covariance).max()) or self.pool.has(covariance)

    def innovation(self, j: int, used: slice) -> ModelInnovation:
        """Of a model, by the right measurement model.

        Args:
            j: its number.
            used: the components of the measurement that the tracker uses.
        """
        model, outputs, scan = SENSOR_MODELS[self.scan.kind], self.bank.ways.outputs, self.scan
        state = self.predicted.mean[j][outputs]
        jacobian = model.jacobian(state, scan.sensor_pose, scan.sensor_velocity)
        covariance = self.predicted.covariance[j][np.ix_(outputs, outputs)]
        expected = [
            model.measure(of, scan.sensor_pose, scan.sensor_velocity) for of in (state, self.after.mean[j][outputs])
        ]
        before, after = (difference(scan.measurement, entry, model.angular)[used] for entry in expected)
        stated = scan.noise_covariance[used, used]
        return ModelInnovation(before, (jacobian @ covariance @ jacobian.T)[used, used] + stated, stated, after)

    def reckoned(self, used: slice) -> Array:
        """``(m,)`` logarithms of the likelihoods by which the models were updated; NaN where an update shows none.

        With ``K = P H^T S^-1`` the measured part of the covariance ``C = H P H^T`` shrinks by ``C S^-1 C``, and that of
        the mean moves by ``C S^-1 y``, whatever noise the model reckons with.
        """
        model, outputs, scan = SENSOR_MODELS[self.scan.kind], self.bank.ways.outputs, self.scan
        reckoned = np.full(len(self.after.probability), np.nan)
        for j, moved in enumerate(self.after.mean - self.predicted.mean):
            state = self.predicted.mean[j][outputs]
            jacobian = model.jacobian(state, scan.sensor_pose, scan.sensor_velocity)[used]
            parts = (of.covariance[j][np.ix_(outputs, outputs)] for of in (self.predicted, self.after))
            before, after = (jacobian @ part @ jacobian.T for part in parts)
            back = np.linalg.pinv(before)
            inverse = linalg.symmetrise(back @ (before - after) @ back.T)
            if np.linalg.eigvalsh(inverse)[0] > 0.0:
                covariance = np.asarray(np.linalg.inv(inverse), dtype=float)
                reckoned[j] = log_density(covariance @ back @ jacobian @ moved[outputs], covariance)
        return reckoned

    @property
    def mixes(self) -> bool:
        """Whether the models start from the mixtures that the transition probabilities give."""
        return self.starts_from(*self.mixed(self.transition))

    @property
    def gained(self) -> Array:
        """``(m,)`` logarithms of what the probabilities were multiplied by, but for a constant."""
        return np.log(self.after.probability) - np.log(self.prior(self.transition))


def log_density(innovation: Array, covariance: Array) -> float:
    """Of a normal distribution."""
    factor = linalg.cholesky(covariance)
    return float(factor.log_density(factor.whiten(innovation)))


def bank_of(tracker: TrackerUnderTest) -> tuple[Bank, list[BankStep]] | None:
    """The models that a tracker holds, and some steps with measurements; None where it holds none.

    Transition probabilities are a constant matrix with rows or columns of sum 1; the models are what has the estimate
    for its mixture. It follows all sensors, or one where that shows none: a wrong mixture may fail with the others.
    """
    found = (_bank_with(tracker, sensor_set) for sensor_set in reversed(tracker.sensor_sets()))
    return next((bank for bank in found if bank is not None), None)


def _bank_with(tracker: TrackerUnderTest, sensor_set: tuple[str, ...]) -> tuple[Bank, list[BankStep]] | None:
    session, random = TrackerSession(tracker.make), np.random.default_rng(tracker.seed)
    scans = tracker.approach(tracker.probes.course_turn, sensor_set)
    constants: list[tuple[Held, Array]] = []
    banks = dict[Bank, list[BankStep]]()
    with tracker.recording_failures(tracker.probes.course_turn.name):
        for k, exact in enumerate(scans):
            if len(scans) - k <= LOOKED and banks and exact.time > session.given[-1].time:
                _look_into(session, banks, exact, random)
            estimate = session.step(with_measurement_noise(exact, random))
            if k == EARLY:
                constants = transition_matrices(_all_held(session))
                if not constants:
                    return None
            if len(scans) - k == LOOKED + 1 and estimate is not None:
                values = _all_held(session)
                banks = _possible(stationary(constants, transition_matrices(values)), values, estimate)
    return max(banks.items(), key=lambda bank: sum(step.mixes for step in bank[1]), default=None)


def _all_held(session: TrackerSession) -> list[Held]:
    inside = session.inside
    return [] if inside is None else [*held_values(inside), *of_module(inside[0])]


def _possible(
    matrices: Sequence[tuple[Held, Array]], values: Sequence[Held], estimate: Estimate
) -> dict[Bank, list[BankStep]]:
    """The models with the first transition probabilities that have some."""
    for where, matrix in matrices:
        matched = found_models(families(values, len(matrix)), estimate, len(matrix))
        if matched:
            return {Bank(where, matrix, *ways): [] for ways in matched}
    return {}


def models_of(session: TrackerSession, bank: Bank) -> Models | None:
    """The models that a tracker holds now."""
    return bank.ways.models(families(_all_held(session), len(bank.transition)))


def _look_into(
    session: TrackerSession, banks: dict[Bank, list[BankStep]], scan: Scan, random: np.random.Generator
) -> None:
    """Add one step of a copy, with a measurement that is some standard deviations off."""
    at_once, missed, copy = session.copy(), session.copy(), session.copy()
    at_once.step(empty_scan(scan._replace(time=session.given[-1].time + INSTANT)))
    estimate = missed.step(empty_scan(scan))
    if estimate is None:
        return
    measured = SENSOR_MODELS[scan.kind].measure(estimate.mean, scan.sensor_pose, scan.sensor_velocity)
    off = np.sqrt(np.diag(scan.noise_covariance)) * random.choice([-INNOVATION, INNOVATION], len(measured))
    scan = scan._replace(measurement=measured + off)
    _, assigned = traced(lambda: copy.step(scan))
    count = len(next(iter(banks)).transition)
    instants = [families(_all_held(instant), count) for instant in (session, at_once, missed, copy)]
    for bank, steps in banks.items():
        before, started, predicted, after = (bank.ways.models(values) for values in instants)
        if before is None or started is None or predicted is None or after is None:
            continue
        if after.probability.min() > 0.0:
            steps.append(BankStep(bank, scan, before, started, predicted, after, assigned))
