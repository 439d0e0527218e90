"""Steps of an interacting multiple model filter, compared with its equations.

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
    ModelPaths,
    Models,
    constant_matrices,
    families,
    find_models,
    transition_matrices,
    values_of_module,
    with_rows,
)
from trackbench.subjects.doctor.inside.values import Assigned, Held, Pool, held_values, trace_step
from trackbench.subjects.doctor.probes import with_measurement_noise
from trackbench.subjects.doctor.session import TrackerSession
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Number of last scans that are looked into, and index of the scan whose constants are compared with those before them.
LOOKED, EARLY = 8, 3
#: Innovation of the measurements that are given, in standard deviations.
INNOVATION = 1.5
#: Time of an instant, s, and the most by which a prediction over it changes a mean, in standard deviations, or a
#: covariance, relative to it.
INSTANT, INSTANTLY = 1e-9, 1e-6
#: Probability below which a model is not compared.
IMPROBABLE = 0.02


@dataclass(frozen=True, eq=False)
class Bank:
    """Models of a filter: their transition probabilities, and where the tracker holds means and covariances."""

    held: Held
    """Matrix of transition probabilities where the tracker holds it, perhaps transposed."""
    transition: Array
    """Transition probabilities ``(m, m)`` from the model of the row to the model of the column."""
    paths: ModelPaths
    fits: bool
    """Whether the tracker returns the covariance of the models' mixture."""


class ModelInnovation(NamedTuple):
    """Innovation of one model at a measurement."""

    value: Array
    """Innovation ``(z,)``: the measurement minus the one predicted by the model."""
    covariance: Array
    """Innovation covariance ``(z, z)``: of the prediction and of the noise."""
    noise: Array
    """Covariance ``(z, z)`` of the measurement noise."""
    updated: Array
    """Residual ``(z,)`` after the update: the measurement minus the one of the updated state."""


class BankStep:
    """A step of a filter with a measurement, and the values that the equations of the module give for it.

    Args:
        bank: models of the tracker.
        scan: scan of the step.
        before: models before the step.
        started: models after a scan without a detection an instant later than ``before``.
        predicted: models after a scan without a detection at the time of ``scan``.
        after: models after ``scan``.
        assigned: values that the tracker's lines assign in the step.
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
        """Set of all numbers that lines of the tracker assign in the step, to look values up in."""
        return Pool(entry.value for entry in self.assigned)

    @cached_property
    def transition(self) -> Array:
        """Transition probabilities ``(m, m)``: the held ones, or those that the step computes for its time.

        The first matrix is taken whose mixtures, or whose transpose's mixtures, the models start from.
        """
        made = (with_rows(entry.value) for entry in self.assigned if entry.value.size == self.bank.transition.size)
        possible = [self.bank.transition, *(matrix for matrix in made if matrix is not None)]
        ways = [*((matrix, matrix) for matrix in possible), *((matrix, matrix.T) for matrix in possible)]
        fitting = (matrix for matrix, used in ways if self.starts_from(self.mixed(used)[0]))
        return next(fitting, self.bank.transition)

    def prior(self, transition: Array) -> Array:
        """Return the probabilities ``(m,)`` of the models after the transition, before the measurement."""
        return transition.T @ self.before.probability

    def mixed(self, transition: Array) -> tuple[Array, Array]:
        """Return means ``(m, n)`` and covariances ``(m, n, n)`` of the mixtures from which the models should start."""
        joint = transition * self.before.probability[:, None]
        mixtures = [self.before.mixed(weights) for weights in (joint / joint.sum(axis=0)).T]
        return np.stack([mean for mean, _ in mixtures]), np.stack([covariance for _, covariance in mixtures])

    def starts_from(self, mean: Array, covariance: Array | None = None) -> bool:
        """Return whether the models start from ``mean``, or from ``covariance`` alone if it is given.

        They do if the models an instant after the last step have the value, or if the step assigns all its numbers.
        """
        sigma = np.sqrt(np.einsum("jaa->ja", self.before.covariance))
        near = np.abs(self.started.mean - mean).max(where=sigma > 0.0, initial=0.0) < INSTANTLY * sigma.max()
        if covariance is None:
            return bool(near) or self.pool.has(mean)
        gap = np.abs(self.started.covariance - covariance).max()
        return bool(gap < INSTANTLY * np.abs(covariance).max()) or self.pool.has(covariance)

    def innovation(self, j: int, used: slice) -> ModelInnovation:
        """Return the innovation of a model, by the right measurement model.

        Args:
            j: index of the model.
            used: components of the measurement that the tracker uses.
        """
        model, outputs, scan = SENSOR_MODELS[self.scan.kind], self.bank.paths.outputs, self.scan
        state = self.predicted.mean[j][outputs]
        jacobian = model.jacobian(state, scan.sensor_pose, scan.sensor_velocity)
        covariance = self.predicted.covariance[j][np.ix_(outputs, outputs)]
        expected = [
            model.measure(x, scan.sensor_pose, scan.sensor_velocity) for x in (state, self.after.mean[j][outputs])
        ]
        before, after = (difference(scan.measurement, entry, model.angular)[used] for entry in expected)
        noise = scan.noise_covariance[used, used]
        return ModelInnovation(before, (jacobian @ covariance @ jacobian.T)[used, used] + noise, noise, after)

    def implied_likelihoods(self, used: slice) -> Array:
        """Return the log likelihoods ``(m,)`` that the updates of the models imply; NaN where an update implies none.

        With ``K = P H^T S^-1`` the measured part of the covariance ``C = H P H^T`` shrinks by ``C S^-1 C``. The
        measured part of the mean moves by ``C S^-1 y``. Both hold whatever noise the model assumes.
        """
        model, outputs, scan = SENSOR_MODELS[self.scan.kind], self.bank.paths.outputs, self.scan
        likelihoods = np.full(len(self.after.probability), np.nan)
        for j, moved in enumerate(self.after.mean - self.predicted.mean):
            state = self.predicted.mean[j][outputs]
            jacobian = model.jacobian(state, scan.sensor_pose, scan.sensor_velocity)[used]
            parts = (models.covariance[j][np.ix_(outputs, outputs)] for models in (self.predicted, self.after))
            before, after = (jacobian @ part @ jacobian.T for part in parts)
            inverse_before = np.linalg.pinv(before)
            inverse = linalg.symmetrise(inverse_before @ (before - after) @ inverse_before.T)
            if np.linalg.eigvalsh(inverse)[0] > 0.0:
                covariance = np.asarray(np.linalg.inv(inverse), dtype=float)
                likelihoods[j] = log_density(covariance @ inverse_before @ jacobian @ moved[outputs], covariance)
        return likelihoods

    @property
    def mixes(self) -> bool:
        """Whether the models start from the mixtures that the transition probabilities give."""
        return self.starts_from(*self.mixed(self.transition))

    @property
    def log_factors(self) -> Array:
        """Logarithms ``(m,)`` of the factors by which the measurement changes the probabilities, up to a constant."""
        return np.log(self.after.probability) - np.log(self.prior(self.transition))


def log_density(innovation: Array, covariance: Array) -> float:
    """Return the logarithm of the normal density of an innovation, with mean zero and ``covariance``."""
    factor = linalg.cholesky(covariance)
    return float(factor.log_density(factor.whiten(innovation)))


def find_bank(tracker: TrackerUnderTest) -> tuple[Bank, list[BankStep]] | None:
    """Return the models that a tracker holds, and some steps with measurements; None where it holds none.

    Transition probabilities are a constant matrix with rows or columns of sum 1; models are values whose mixture is the
    estimate. A target is followed with all sensors, or with one sensor where a step with all fails.
    """
    banks = (_bank_with(tracker, sensor_set) for sensor_set in reversed(tracker.sensor_sets()))
    return next((bank for bank in banks if bank is not None), None)


def _bank_with(tracker: TrackerUnderTest, sensor_set: tuple[str, ...]) -> tuple[Bank, list[BankStep]] | None:
    session, random = TrackerSession(tracker.make), np.random.default_rng(tracker.seed)
    scans = tracker.approach(tracker.probes.course_turn, sensor_set)
    constants: list[tuple[Held, Array]] = []
    banks = dict[Bank, list[BankStep]]()
    with tracker.recording_failures(tracker.probes.course_turn.name):
        for k, exact in enumerate(scans):
            if len(scans) - k <= LOOKED and banks and exact.time > session.scans[-1].time:
                _add_steps(session, banks, exact, random)
            estimate = session.step(with_measurement_noise(exact, random))
            if k == EARLY:
                constants = transition_matrices(_all_held(session))
                if not constants:
                    return None
            if len(scans) - k == LOOKED + 1 and estimate is not None:
                values = _all_held(session)
                banks = _possible_banks(constant_matrices(constants, transition_matrices(values)), values, estimate)
    return max(banks.items(), key=lambda bank: sum(step.mixes for step in bank[1]), default=None)


def _all_held(session: TrackerSession) -> list[Held]:
    inside = session.inside
    return [] if inside is None else [*held_values(inside), *values_of_module(inside[0])]


def _possible_banks(
    matrices: Sequence[tuple[Held, Array]], values: Sequence[Held], estimate: Estimate
) -> dict[Bank, list[BankStep]]:
    """Return possible banks, without steps yet, for the first transition matrix that fits any models."""
    for held, matrix in matrices:
        matched = find_models(families(values, len(matrix)), estimate, len(matrix))
        if matched:
            return {Bank(held, matrix, *match): [] for match in matched}
    return {}


def models_of(session: TrackerSession, bank: Bank) -> Models | None:
    """Return the models that a tracker holds now; None where a mean, covariance or probability is missing."""
    return bank.paths.models(families(_all_held(session), len(bank.transition)))


def _add_steps(
    session: TrackerSession, banks: dict[Bank, list[BankStep]], scan: Scan, random: np.random.Generator
) -> None:
    """Step a copy of the session with a measurement 1.5 standard deviations off the predicted one.

    What each bank of models did in the step is appended to that bank's list.
    """
    instant_later, missed, copy = session.copy(), session.copy(), session.copy()
    instant_later.step(empty_scan(scan._replace(time=session.scans[-1].time + INSTANT)))
    estimate = missed.step(empty_scan(scan))
    if estimate is None:
        return
    measured = SENSOR_MODELS[scan.kind].measure(estimate.mean, scan.sensor_pose, scan.sensor_velocity)
    innovation = np.sqrt(np.diag(scan.noise_covariance)) * random.choice([-INNOVATION, INNOVATION], len(measured))
    scan = scan._replace(measurement=measured + innovation)
    _, assigned = trace_step(lambda: copy.step(scan))
    count = len(next(iter(banks)).transition)
    instants = [families(_all_held(instant), count) for instant in (session, instant_later, missed, copy)]
    for bank, steps in banks.items():
        before, started, predicted, after = (bank.paths.models(values) for values in instants)
        if before is None or started is None or predicted is None or after is None:
            continue
        if after.probability.min() > 0.0:
            steps.append(BankStep(bank, scan, before, started, predicted, after, assigned))
