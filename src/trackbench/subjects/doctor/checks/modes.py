"""Does an interacting multiple model filter mix, weigh and combine its models as its transition probabilities say?

The filter is found by its values in a tracker that runs in this process; `inside.interaction` has the equations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import product

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.inside.interaction import IMPROBABLE, BankStep, ModelInnovation, find_bank, log_density
from trackbench.subjects.doctor.inside.values import Pool, nearest_assigned, with_value
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Largest error of the logarithm of a ratio of probabilities: with a lidar, where a Kalman filter has 1e-9; and with a
#: curved measurement, whose innovation covariance by sigma points is not that by the Jacobian.
ROUNDED, CURVED = 1e-6, 0.1
#: Least logarithm of a ratio of likelihoods that shows what they follow from: with a lidar, and with a radar.
TOLD = 0.005, 0.05
#: Least correlation at which probabilities follow from likelihoods of another noise than the stated one.
FOLLOWS = 0.7
CONFIDENCE = 0.97

#: Components of a measurement that a tracker may use: all of them, or the position alone.
USED = (slice(None), slice(2))


def _density(y: ModelInnovation) -> float:
    return log_density(y.value, y.covariance)


def _density_with_root(y: ModelInnovation) -> float:
    """Return an innovation's log density, computed wrongly with variances in place of standard deviations."""
    factor = linalg.cholesky(y.covariance)
    inverse = np.array(factor.inverse_diagonal)
    return float(-0.5 * np.sum((factor.whiten(y.value) * inverse) ** 2) + 2.0 * np.log(inverse).sum())


#: Wrong rules for the logarithm of a factor of a model's probability: in words, and as functions of the innovation and
#: of the probabilities before and after the transition.
WRONG_RULES: dict[str, Callable[[ModelInnovation, float, float], float]] = {
    "they do not depend on the measurement": lambda *_: 0.0,
    "the likelihood is that of the innovation after the update": lambda y, *_: log_density(y.updated, y.covariance),
    "the innovation covariance is taken for its inverse": lambda y, *_: float(-0.5 * y.value @ y.covariance @ y.value),
    "the innovation covariance is taken for its root": lambda y, *_: _density_with_root(y),
    "the determinant of the innovation covariance is left out of the likelihood": lambda y, *_: float(
        -0.5 * y.value @ np.linalg.solve(y.covariance, y.value)
    ),
    "the likelihood has the determinant of the innovation covariance, and not its logarithm": lambda y, *_: float(
        -0.5 * (y.value @ np.linalg.solve(y.covariance, y.value) + np.linalg.det(y.covariance))
    ),
    "the likelihood is that of the stated noise, without the covariance of the prediction": lambda y, *_: log_density(
        y.value, y.noise
    ),
    "the probabilities before the measurement are left out": lambda y, _, after: _density(y) - float(np.log(after)),
    "the probabilities before the measurement are those before the transition": lambda y, before, after: (
        _density(y) + float(np.log(before / after))
    ),
}


@doctor_check(
    Question("mixing", "Does each model start from the mixture that the transition probabilities give?"),
    Question("mode_probabilities", "Do the models' probabilities follow from the likelihoods of innovations?"),
    Question("combination", "Is the estimate the mixture of the models?"),
    place=35,
    faults={
        "imm_transition_transposed": KnownFault(
            "the transition probabilities of the models are transposed",
            "Where the probabilities of the models are multiplied by the transition probabilities.",
            "c_j = sum over i of pi_ij mu_i, and w_ij = pi_ij mu_i / c_j, with i the model before and j the one after.",
            Role("exact", rank=2, drive="long_run"),
        ),
        "imm_mixing_wrong": KnownFault(
            "the models start from a wrong mixture",
            "Where the means and covariances of the models are mixed before the prediction.",
            "Model j starts from x_0j = sum over i of w_ij x_i and P_0j = sum over i of w_ij (P_i + (x_i - x_0j)(x_i - "
            "x_0j)^T), of the estimates of all models before any is replaced.",
            Role("exact", rank=3, drive="long_run"),
        ),
        "imm_likelihood_wrong": KnownFault(
            "the probabilities of the models do not follow from their likelihoods",
            "Where the probabilities of the models are updated after a measurement.",
            "mu_j = c_j N(y_j; 0, S_j), divided by their sum, with the innovation y_j and its covariance S_j of each "
            "model before its update, and the determinant of S_j.",
            Role("exact", rank=4, drive="long_run"),
        ),
        "imm_combination_wrong": KnownFault(
            "the covariance that is returned is not that of the mixture of the models",
            "Where the estimates of the models are combined.",
            "P = sum over j of mu_j (P_j + (x_j - x)(x_j - x)^T), with the probabilities after the measurement.",
            Role("exact", rank=5, drive="long_run"),
        ),
    },
)
def modes(tracker: TrackerUnderTest) -> PartResult:
    """Compare the models' starts, their probabilities and the estimate with the equations of the filter."""
    bank_steps = tracker.once(find_bank)
    if bank_steps is None:
        return PartResult()
    result = PartResult()
    bank, steps = bank_steps
    steps = [step for step in steps if step.after.probability.min() > 0.0 and step.before.probability.min() > 0.0]
    if not steps:
        return result.add("mixing", None, "the probability of a model is 0")
    start = _mixing_fault(steps)
    rule = "each model starts from the mixture that the transition probabilities give"
    result.add_evidence("mixing", start, rule)
    weighed = None if start is not None and start.fault == "imm_transition_transposed" else _probability_fault(steps)
    rule = "the probabilities are multiplied by the likelihoods of the innovations"
    result.add_evidence("mode_probabilities", weighed, rule)
    output = None if bank.fits else _combination_fault(steps[-1])
    rule = "the estimate is the mixture of the models, its covariance with the spread of their means"
    result.add_evidence("combination", output, rule)
    return result


def _mixing_fault(steps: Sequence[BankStep]) -> Finding | None:
    """Report wrong mixtures from which the models start in most steps."""
    mixed = [(step, *step.mixed(step.transition)) for step in steps]
    # The more equal the probabilities, the more the mixtures differ.
    step, mean, covariance = max(mixed, key=lambda entry: entry[0].before.probability.min())
    if not _mostly(entry.starts_from(right) for entry, right, _ in mixed):
        turned = [entry.starts_from(entry.mixed(entry.transition.T)[0]) for entry in steps]
        if _mostly(turned) and not np.allclose(step.transition, step.transition.T):
            return _transposed(step, step.transition)
        unmixed = all(np.allclose(entry.started.mean, entry.before.mean, rtol=1e-6) for entry in steps)
        words = "each model goes on from its own estimate" if unmixed else _find_line(step, mean, step.before.mean)
        return _mixing(step, f"the mixed means are not those of the transition probabilities: {words}")
    if _mostly(entry.starts_from(right, spread) for entry, right, spread in mixed):
        return None
    joint = step.transition * step.before.probability[:, None]
    within = np.einsum("ij,iab->jab", joint / joint.sum(axis=0), step.before.covariance)
    left_out = step.starts_from(mean, within)
    words = "the spread of the means is left out" if left_out else _find_line(step, covariance, step.before.covariance)
    return _mixing(step, f"the mixed means are right, and the covariances about them are not: {words}")


def _mostly(are_right: Iterable[bool]) -> bool:
    """Return whether more than half of the steps are right: a step in which the models agree tells nothing."""
    return float(np.mean(list(are_right))) > 0.5


def _find_line(step: BankStep, right: Array, before: Array) -> str:
    """Name the tracker's line before the prediction that assigns the value nearest to ``right`` but not equal."""
    later = (k for k, entry in enumerate(step.assigned) if Pool([entry.value]).has(step.predicted.mean[0]))
    closest = nearest_assigned(step.assigned[: next(later, None)], right, before)
    if closest is None:
        return "nothing like them is computed"
    assigned, error = closest
    return f"{assigned.where}, {assigned.name}, is the nearest to them, and off by {error:.2g} of the largest entry"


def _transposed(step: BankStep, transition: Array) -> Finding:
    joint = transition.T * step.before.probability[:, None]
    assignment = with_value(step.assigned, joint, joint / joint.sum(axis=0), joint.sum(axis=0))
    where = "" if assignment is None else f" ({assignment.where}, {assignment.name})"
    text = (
        f"the models start from the mixtures of the transposed transition probabilities{where}: "
        f"{_matrix(transition)} is held with a row for the model before, and used with a column for it"
    )
    return Finding("imm_transition_transposed", CONFIDENCE, text, shown_by="course_turn")


def _matrix(matrix: Array) -> str:
    return "[" + ", ".join("[" + ", ".join(f"{value:.3g}" for value in row) + "]" for row in matrix) + "]"


def _mixing(step: BankStep, text: str) -> Finding:
    weights = ", ".join(f"{value:.3g}" for value in step.before.probability)
    return Finding("imm_mixing_wrong", CONFIDENCE, f"{text} (at {step.scan.time:.4g} s, probabilities {weights})")


def _probability_fault(steps: Sequence[BankStep]) -> Finding | None:
    """Report probabilities that are wrong after most measurements that tell the models apart."""
    total = float(steps[-1].after.probability.sum())
    if abs(total - 1.0) > ROUNDED:
        text = f"the probabilities of the models add up to {total:.4g} after a measurement"
        return Finding("imm_likelihood_wrong", CONFIDENCE, text)
    telling = [
        step
        for step in steps
        if min(step.before.probability.min(), step.after.probability.min()) > IMPROBABLE
        and step.pool.has(step.predicted.mean)
        and max(np.ptp(_factors(step, USED[0])), np.ptp(step.log_factors)) > TOLD[step.scan.kind != "lidar"]
    ]
    used = min(USED, key=lambda used: _median_error(telling, used))
    wrong = list[BankStep]()
    for kind in sorted({step.scan.kind for step in telling}):
        of_kind = [step for step in telling if step.scan.kind == kind]
        failing = [step for step in of_kind if not _follows(step, used)]
        wrong += failing if len(failing) > len(of_kind) / 2 else []
    if not wrong:
        return None
    # The likelihoods of a radar can be so small that they are cut off.
    exact = [step for step in wrong if step.scan.kind == "lidar"]
    for group, (words, rule), part in product((wrong, exact), WRONG_RULES.items(), USED):
        if group and all(_error(step, _factors(step, part, rule)) < _tolerance(step) for step in group):
            return _wrong_probabilities(wrong, telling, words)
    # A tracker may assume another noise, or another geometry: then its updates show it.
    as_stated = _mostly(
        float(np.ptp(_factors(step, used) - step.implied_likelihoods(used))) < _tolerance(step) for step in wrong
    )
    log_factors = np.concatenate([step.log_factors - step.log_factors[0] for step in wrong])
    right = np.concatenate([factors - factors[0] for factors in (_factors(step, used) for step in wrong)])
    if not as_stated and float(np.corrcoef(log_factors, right)[0, 1]) > FOLLOWS:
        return None
    return _wrong_probabilities(wrong, telling, "they do not follow from the likelihoods")


def _follows(step: BankStep, used: slice) -> bool:
    """Return whether the probabilities follow from the right likelihoods, or from those that the updates imply."""
    possible = (_factors(step, used), *map(step.implied_likelihoods, USED))
    return any(_error(step, factors) <= _tolerance(step) for factors in possible)


def _wrong_probabilities(wrong: Sequence[BankStep], telling: Sequence[BankStep], words: str) -> Finding:
    step = max(wrong, key=lambda entry: _error(entry, _factors(entry, USED[0])))
    both = (step.log_factors, _factors(step, USED[0]))
    ratio, right = (float(np.exp(factors[1] - factors[0])) for factors in both)
    text = (
        f"{words}: at {step.scan.time:.4g} s a measurement of {step.scan.sensor} multiplies the probability of model 2 "
        f"by {ratio:.3g} times what it does that of model 1, and the innovations and their covariances give "
        f"{right:.3g} ({len(wrong)} of {len(telling)} steps)"
    )
    sensors = {entry.scan.sensor for entry in wrong}
    only = sensors.pop() if len(sensors) == 1 and len({entry.scan.sensor for entry in telling}) > 1 else None
    return Finding("imm_likelihood_wrong", CONFIDENCE, text, sensor=only)


def _factors(
    step: BankStep, used: slice, rule: Callable[[ModelInnovation, float, float], float] = lambda y, *_: _density(y)
) -> Array:
    """Return the logarithms ``(m,)`` of the factors by which ``rule`` multiplies the models' probabilities."""
    before, after = step.before.probability, step.prior(step.transition)
    return np.array([rule(step.innovation(j, used), before[j], after[j]) for j in range(len(after))])


def _median_error(steps: Sequence[BankStep], used: slice) -> float:
    """Return the steps' median error of `_factors`, relative to how much the factors differ between the models."""
    pairs = [(step, _factors(step, used)) for step in steps]
    return float(np.median([_error(step, logs) / max(float(np.ptp(logs)), TOLD[0]) for step, logs in pairs] or [0.0]))


def _error(step: BankStep, factors: Array) -> float:
    """Return the largest error of the log ratio of two models' probabilities; ``factors`` are the right log factors."""
    return float(np.ptp(step.log_factors - factors))


def _tolerance(step: BankStep) -> float:
    return (ROUNDED if step.scan.kind == "lidar" else CURVED) * (1.0 + float(np.ptp(_factors(step, USED[0]))))


def _combination_fault(step: BankStep) -> Finding:
    _, covariance = step.after.mixed(step.after.probability)
    outputs = step.bank.paths.outputs
    right = covariance[np.ix_(outputs, outputs)]
    within = np.einsum("j,jab->ab", step.after.probability, step.after.covariance)
    closest = nearest_assigned(step.assigned, covariance, np.zeros(0))
    where = "" if closest is None else f" ({closest[0].where}, {closest[0].name})"
    words = "the spread of the models' means is left out" if step.pool.has(within) else f"it is another one{where}"
    text = (
        f"the mean that is returned is the mixture of the models, and the covariance is not theirs: {words}; the "
        f"standard deviation of px is {np.sqrt(right[0, 0]):.3g} m in the mixture"
    )
    return Finding("imm_combination_wrong", CONFIDENCE, text)
