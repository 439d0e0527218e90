"""Does an interacting multiple model filter mix, weigh and combine its models as its transition probabilities say?

It is looked for by its values in a tracker that runs in this process; see `inside.interaction` for the equations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import product

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.inside.interaction import IMPROBABLE, BankStep, ModelInnovation, bank_of, log_density
from trackbench.subjects.doctor.inside.values import Pool, nearest_assigned, with_value
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Error of a logarithm of a ratio of probabilities: of a Kalman filter 1e-9; sigma points have another innovation
#: covariance than the Jacobian where a measurement is curved.
ROUNDED, CURVED = 1e-6, 0.1
#: Logarithm of a ratio of likelihoods from which on they can be told from other ones: of a lidar, and of a radar.
TOLD = 0.005, 0.05
#: Correlation from which on probabilities follow from likelihoods of another noise than the stated one.
FOLLOWS = 0.7
CONFIDENCE = 0.97

#: What a tracker may use of a measurement: all of it, or the position alone.
USED = (slice(None), slice(2))


def _density(of: ModelInnovation) -> float:
    return log_density(of.value, of.covariance)


def _of_root(of: ModelInnovation) -> float:
    """By the variances of the components, each given those before it, in place of their standard deviations."""
    factor = linalg.cholesky(of.covariance)
    inverse = np.array(factor.inverse_diagonal)
    return float(-0.5 * np.sum((factor.whiten(of.value) * inverse) ** 2) + 2.0 * np.log(inverse).sum())


#: What the logarithm of a probability may have grown by instead: by the innovation, and by the probability before the
#: transition and after it.
INSTEAD: dict[str, Callable[[ModelInnovation, float, float], float]] = {
    "they do not depend on the measurement": lambda *_: 0.0,
    "the likelihood is that of the innovation after the update": lambda of, *_: log_density(of.updated, of.covariance),
    "the innovation covariance is taken for its inverse": lambda of, *_: float(
        -0.5 * of.value @ of.covariance @ of.value
    ),
    "the innovation covariance is taken for its root": lambda of, *_: _of_root(of),
    "the determinant of the innovation covariance is left out of the likelihood": lambda of, *_: float(
        -0.5 * of.value @ np.linalg.solve(of.covariance, of.value)
    ),
    "the likelihood has the determinant of the innovation covariance, and not its logarithm": lambda of, *_: float(
        -0.5 * (of.value @ np.linalg.solve(of.covariance, of.value) + np.linalg.det(of.covariance))
    ),
    "the likelihood is that of the stated noise, without the covariance of the prediction": lambda of, *_: log_density(
        of.value, of.noise
    ),
    "the probabilities before the measurement are left out": lambda of, _, after: _density(of) - float(np.log(after)),
    "the probabilities before the measurement are those before the transition": lambda of, before, after: (
        _density(of) + float(np.log(before / after))
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
    """Hold the models' starts, their probabilities and the estimate against the equations; nothing of other filters."""
    bank_steps = tracker.once(bank_of)
    if bank_steps is None:
        return PartResult()
    result = PartResult()
    bank, steps = bank_steps
    steps = [step for step in steps if step.after.probability.min() > 0.0 and step.before.probability.min() > 0.0]
    if not steps:
        return result.add("mixing", None, "the probability of a model is 0")
    start = _start(steps)
    rule = "each model starts from the mixture that the transition probabilities give"
    result.add_evidence("mixing", start, rule)
    weighed = None if start is not None and start.fault == "imm_transition_transposed" else _weights(steps)
    rule = "the probabilities are multiplied by the likelihoods of the innovations"
    result.add_evidence("mode_probabilities", weighed, rule)
    output = None if bank.fits else _output(steps[-1])
    rule = "the estimate is the mixture of the models, its covariance with the spread of their means"
    result.add_evidence("combination", output, rule)
    return result


def _start(steps: Sequence[BankStep]) -> Finding | None:
    """What is wrong with the mixtures from which the models start, if it is in every step."""
    mixed = [(step, *step.mixed(step.transition)) for step in steps]
    # The more equal the probabilities, the more the mixtures differ.
    step, mean, covariance = max(mixed, key=lambda entry: entry[0].before.probability.min())
    if not _mostly(of.starts_from(right) for of, right, _ in mixed):
        turned = [of.starts_from(of.mixed(of.transition.T)[0]) for of in steps]
        if _mostly(turned) and not np.allclose(step.transition, step.transition.T):
            return _transposed(step, step.transition)
        unmixed = all(np.allclose(of.started.mean, of.before.mean, rtol=1e-6) for of in steps)
        words = "each model goes on from its own estimate" if unmixed else _line(step, mean, step.before.mean)
        return _mixing(step, f"the mixed means are not those of the transition probabilities: {words}")
    if _mostly(of.starts_from(right, about) for of, right, about in mixed):
        return None
    joint = step.transition * step.before.probability[:, None]
    within = np.einsum("ij,iab->jab", joint / joint.sum(axis=0), step.before.covariance)
    left_out = step.starts_from(mean, within)
    words = "the spread of the means is left out" if left_out else _line(step, covariance, step.before.covariance)
    return _mixing(step, f"the mixed means are right, and the covariances about them are not: {words}")


def _mostly(right: Iterable[bool]) -> bool:
    """Whether it is so in more than half of the steps: one in which the models agree tells nothing."""
    return float(np.mean(list(right))) > 0.5


def _line(step: BankStep, right: Array, before: Array) -> str:
    """The line before the prediction that makes what is nearest to a right value of a model and is not right itself."""
    later = (k for k, entry in enumerate(step.assigned) if Pool([entry.value]).has(step.predicted.mean[0]))
    closest = nearest_assigned(step.assigned[: next(later, None)], right, before)
    if closest is None:
        return "nothing like them is computed"
    assigned, error = closest
    return f"{assigned.where}, {assigned.name}, is the nearest to them, and off by {error:.2g} of the largest entry"


def _transposed(step: BankStep, transition: Array) -> Finding:
    joint = transition.T * step.before.probability[:, None]
    at = with_value(step.assigned, joint, joint / joint.sum(axis=0), joint.sum(axis=0))
    where = "" if at is None else f" ({at.where}, {at.name})"
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


def _weights(steps: Sequence[BankStep]) -> Finding | None:
    """What is wrong with the probabilities after a measurement, if it is in most steps that tell it."""
    total = float(steps[-1].after.probability.sum())
    if abs(total - 1.0) > ROUNDED:
        text = f"the probabilities of the models add up to {total:.4g} after a measurement"
        return Finding("imm_likelihood_wrong", CONFIDENCE, text)
    telling = [
        step
        for step in steps
        if min(step.before.probability.min(), step.after.probability.min()) > IMPROBABLE
        and step.pool.has(step.predicted.mean)
        and max(np.ptp(_grown(step, USED[0])), np.ptp(step.gained)) > TOLD[step.scan.kind != "lidar"]
    ]
    used = min(USED, key=lambda used: _unlike(telling, used))
    wrong = list[BankStep]()
    for kind in sorted({step.scan.kind for step in telling}):
        of_kind = [step for step in telling if step.scan.kind == kind]
        off = [step for step in of_kind if not _follows(step, used)]
        wrong += off if len(off) > len(of_kind) / 2 else []
    if not wrong:
        return None
    # The likelihoods of a radar can be so small that they are cut off.
    exact = [step for step in wrong if step.scan.kind == "lidar"]
    for some, (words, instead), part in product((wrong, exact), INSTEAD.items(), USED):
        if some and all(_error(step, _grown(step, part, instead)) < _tolerance(step) for step in some):
            return _weighed_wrongly(wrong, telling, words)
    # The noise that a tracker reckons with, or the geometry, may be another one: then its updates show it.
    as_stated = _mostly(float(np.ptp(_grown(step, used) - step.reckoned(used))) < _tolerance(step) for step in wrong)
    gained = np.concatenate([step.gained - step.gained[0] for step in wrong])
    right = np.concatenate([grown - grown[0] for grown in (_grown(step, used) for step in wrong)])
    if not as_stated and float(np.corrcoef(gained, right)[0, 1]) > FOLLOWS:
        return None
    return _weighed_wrongly(wrong, telling, "they do not follow from the likelihoods")


def _follows(step: BankStep, used: slice) -> bool:
    """Whether the probabilities follow from the right likelihoods, or from those that the models' updates show."""
    return any(_error(step, of) <= _tolerance(step) for of in (_grown(step, used), *map(step.reckoned, USED)))


def _weighed_wrongly(wrong: Sequence[BankStep], telling: Sequence[BankStep], words: str) -> Finding:
    step = max(wrong, key=lambda entry: _error(entry, _grown(entry, USED[0])))
    ratio, right = (float(np.exp(of[1] - of[0])) for of in (step.gained, _grown(step, USED[0])))
    text = (
        f"{words}: at {step.scan.time:.4g} s a measurement of {step.scan.sensor} multiplies the probability of model 2 "
        f"by {ratio:.3g} times what it does that of model 1, and the innovations and their covariances give "
        f"{right:.3g} ({len(wrong)} of {len(telling)} steps)"
    )
    sensors = {entry.scan.sensor for entry in wrong}
    only = sensors.pop() if len(sensors) == 1 and len({entry.scan.sensor for entry in telling}) > 1 else None
    return Finding("imm_likelihood_wrong", CONFIDENCE, text, sensor=only)


def _grown(
    step: BankStep, used: slice, by: Callable[[ModelInnovation, float, float], float] = lambda of, *_: _density(of)
) -> Array:
    """``(m,)`` logarithms of what the probabilities grow by."""
    before, after = step.before.probability, step.prior(step.transition)
    return np.array([by(step.innovation(j, used), before[j], after[j]) for j in range(len(after))])


def _unlike(steps: Sequence[BankStep], used: slice) -> float:
    """Median error relative to what there is to follow."""
    grown = [(step, _grown(step, used)) for step in steps]
    return float(np.median([_error(step, of) / max(float(np.ptp(of)), TOLD[0]) for step, of in grown] or [0.0]))


def _error(step: BankStep, grown: Array) -> float:
    """Largest error of a logarithm of a ratio of probabilities."""
    return float(np.ptp(step.gained - grown))


def _tolerance(step: BankStep) -> float:
    return (ROUNDED if step.scan.kind == "lidar" else CURVED) * (1.0 + float(np.ptp(_grown(step, USED[0]))))


def _output(step: BankStep) -> Finding:
    _, covariance = step.after.mixed(step.after.probability)
    outputs = step.bank.ways.outputs
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
