"""Options of a multi-object tracker: association of detections, and rules for tracks to begin and end."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, Tag

from trackbench.base.config import (
    LIST,
    MAPPING,
    NUMBER,
    WORD,
    Config,
    NonNegative,
    Positive,
    Probability,
    Problem,
    Sigma,
    chosen_by,
    number_or_list,
    problem_error,
    shape,
)

AssociationMethod = Literal["gnn", "jpda", "jipda", "pmb", "oracle", "naive"]
Fraction = Annotated[float, Field(gt=0, lt=1)]

#: Methods that confirm tracks by counting or by score, and methods with existence probabilities.
COUNTING: tuple[AssociationMethod, ...] = ("gnn", "jpda", "oracle", "naive")
EXISTENCE: tuple[AssociationMethod, ...] = ("jipda", "pmb")
#: Methods that use a key, for keys that not all methods use.
METHODS: dict[str, tuple[AssociationMethod, ...]] = {
    "gate": ("gnn", "jpda", "jipda", "pmb", "naive"),
    "report_existence": EXISTENCE,
    "delete_existence": EXISTENCE,
    "lifetime_s": EXISTENCE,
    "visible_s": EXISTENCE,
    "birth_rate_hz": EXISTENCE,
    "undetected": EXISTENCE,
    "birth_density": EXISTENCE,
}
#: Methods that can confirm tracks by a rule; all methods can confirm by counting.
CONFIRMED_BY: dict[str, tuple[AssociationMethod, ...]] = {"score": ("gnn", "jpda"), "existence": EXISTENCE}
#: Most scans within which a track may be confirmed.
LONGEST_WINDOW = 100


def _require_rule(value: Any) -> Any:
    is_pair = isinstance(value, list) and len(value) == 2 and {type(number) for number in value} == {int}
    if value in ("score", "existence") or is_pair:
        return value
    raise problem_error(f"[M, N], such as [3, 5], score or existence is needed, not {value}")


class GaussianBirths(Config):
    """Region in which new objects appear: a Gaussian with equal standard deviations along x and y."""

    x: float = Field(ge=-1e8, le=1e8, description="Mean along x in the fixed frame, m.")
    y: float = Field(ge=-1e8, le=1e8, description="Mean along y in the fixed frame, m.")
    sigma_m: Sigma = Field(description="Standard deviation, m.")


class AssociateConfig(Config):
    """Options for tracking several objects from detections without identities."""

    method: AssociationMethod = Field(
        description="gnn: global nearest neighbour. jpda: joint probabilistic data association. jipda: the same with "
        "existence probabilities. pmb: Poisson multi-Bernoulli filter. oracle: knows which object caused each "
        "detection. naive: each detection, in the order of the list, goes to the nearest track."
    )
    gate: Fraction = Field(
        0.9999,
        description="Probability that an object's detection falls into the gate of its track (chi-square); not oracle.",
    )
    confirm: Annotated[
        Annotated[list[int], Field(min_length=2, max_length=2)] | Literal["score", "existence"] | None,
        BeforeValidator(_require_rule),
    ] = Field(
        None,
        description="[M, N], all methods: a track is confirmed with M detections in its first N scans, the one that "
        "started it included, and deleted as soon as it can no longer have them. score, gnn and jpda: where the "
        "logarithm of the likelihood ratio of object and false alarms reaches 12; it is deleted 10 below its largest. "
        "existence, jipda and pmb: by its probability. Unless given, [3, 5] for gnn, jpda and naive, existence for "
        "jipda and pmb, and at once, [1, 1], for oracle.",
    )
    delete_after_s: Positive = Field(
        1,
        description="A track is deleted this long after its latest detection, s; several periods of the slowest "
        "sensor.",
    )
    report_existence: Annotated[
        Annotated[Fraction, Tag(NUMBER)] | Annotated[list[Fraction], Field(min_length=2, max_length=2), Tag(LIST)],
        chosen_by(number_or_list, "write a probability, such as 0.5, or two, such as [0.95, 0.5]"),
    ] = Field(
        [0.95, 0.5],
        description="jipda and pmb. A track is confirmed when its probability of existence reaches the first of two "
        "numbers, and from then on is reported while it is at least the second; below, it keeps its id. One number is "
        "both, and is needed with confirm: [M, N], whose count confirms.",
    )
    delete_existence: Fraction = Field(
        1e-4, description="jipda and pmb. A track is deleted below this probability of existence."
    )
    lifetime_s: Positive = Field(
        60, description="jipda and pmb. Mean time that an object stays, s; existence fades at this rate."
    )
    visible_s: Positive | None = Field(
        10,
        description="jipda and pmb. Mean time until an object that stays is hidden, s; null: none ever is, and each "
        "scan without a detection speaks against its existence.",
    )
    birth_rate_hz: Positive = Field(
        0.2, description="jipda and pmb. Expected number of objects per second that come into the view of each sensor."
    )
    undetected: NonNegative = Field(
        10, description="jipda and pmb. Expected number of objects in the view of a sensor before its first scan."
    )
    birth_density: Annotated[
        Annotated[Literal["uniform"], Tag(WORD)] | Annotated[GaussianBirths, Tag(MAPPING)],
        chosen_by(shape, "write uniform, or the mean and standard deviation of a Gaussian: {x: 0, y: 0, sigma_m: 50}"),
    ] = Field(
        "uniform",
        description="jipda and pmb. Where those objects are expected: uniform over the view of each sensor, or a "
        "Gaussian, whose numbers are then those of the whole plane; it should lie in the view.",
    )
    detection_probability: dict[str, Probability] = Field(
        default_factory=dict,
        description="For a sensor's name, the detection probability that the tracker takes in place of the stated one.",
    )

    @property
    def confirms_by(self) -> list[int] | Literal["score", "existence"]:
        """Rule of confirmation, M of N or by name: the option ``confirm``, or the association method's default."""
        if self.confirm is not None:
            return self.confirm
        if self.method in EXISTENCE:
            return "existence"
        # The oracle knows the false alarms.
        return [1, 1] if self.method == "oracle" else [3, 5]

    @property
    def report_limits(self) -> tuple[float, float]:
        """Least existence probability that confirms a track, and least one at which a confirmed track is reported."""
        limits = self.report_existence
        return (limits[0], limits[1]) if isinstance(limits, list) else (limits, limits)

    @property
    def confirmation(self) -> str:
        """Rule of confirmation in words, for messages and tables."""
        rule = self.confirms_by
        return rule if isinstance(rule, str) else f"{rule[0]} of {rule[1]}"

    def problems(self) -> Iterator[Problem]:
        rule, stated = self.confirms_by, self.model_fields_set
        for key in (name for name in type(self).model_fields if name in stated):
            methods = METHODS.get(key, (self.method,))
            if self.method not in methods:
                yield Problem((key,), f"not used with method: {self.method}; remove it, or use {' or '.join(methods)}")
        if isinstance(rule, str):
            if self.method not in CONFIRMED_BY[rule]:
                message = (
                    f"{rule} is not used with method: {self.method}; use [M, N], or {' or '.join(CONFIRMED_BY[rule])}"
                )
                yield Problem(("confirm",), message)
        else:
            needed, scans = rule
            if not 1 <= needed <= scans <= LONGEST_WINDOW:
                limits = f"1 to N, and N at most {LONGEST_WINDOW}"
                yield Problem(("confirm",), f"[M, N] needs M from {limits}, not [{needed}, {scans}]")
        if self.method in EXISTENCE:
            confirmed, reported = self.report_limits
            if isinstance(rule, list) and isinstance(self.report_existence, list) and "report_existence" in stated:
                yield Problem(("report_existence",), f"one number is needed, such as {reported:g}: [M, N] confirms")
            if reported > confirmed:
                yield Problem(("report_existence",), f"the larger comes first: [{reported:g}, {confirmed:g}]")
            if self.delete_existence > reported:
                message = f"must not exceed that down to which tracks are reported, {reported:g} of report_existence"
                yield Problem(("delete_existence",), message)
