"""How a tracker of several objects associates detections with its tracks, and when tracks begin and end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from trackbench.base.config import Config, NonNegative, Positive, Probability, Problem, problem_error

AssociationMethod = Literal["gnn", "jpda", "jipda", "pmb", "oracle", "naive"]
Fraction = Annotated[float, Field(gt=0, lt=1)]

#: Methods that confirm tracks by counting or by score; the others by the probability that the object exists.
COUNTING: tuple[AssociationMethod, ...] = ("gnn", "jpda", "oracle", "naive")
EXISTENCE: tuple[AssociationMethod, ...] = ("jipda", "pmb")
#: Methods in which several tracks may take a share of one detection.
SHARING: tuple[AssociationMethod, ...] = ("jpda", "jipda", "pmb")
#: The methods that have a key, where not all have it.
METHODS: dict[str, tuple[AssociationMethod, ...]] = {
    "gate": ("gnn", "jpda", "jipda", "pmb", "naive"),
    "confirm_score": ("gnn", "jpda"),
    "score_drop": ("gnn", "jpda"),
    "delete_misses": COUNTING,
    "confirm_existence": EXISTENCE,
    "end_existence": EXISTENCE,
    "delete_existence": EXISTENCE,
    "lifetime_s": EXISTENCE,
    "visible_s": EXISTENCE,
    "hidden_s": EXISTENCE,
    "birth_rate_hz": EXISTENCE,
    "undetected": EXISTENCE,
    "max_cluster": SHARING,
}
#: The methods that confirm tracks by a rule; each can by counting.
CONFIRMED_BY: dict[str, tuple[AssociationMethod, ...]] = {"score": ("gnn", "jpda"), "existence": EXISTENCE}
#: The rule that a key belongs to.
RULE_OF = {"confirm_score": "score", "score_drop": "score", "confirm_existence": "existence"}
#: Most scans within which a track may be confirmed.
LONGEST_WINDOW = 100


def _only(fits: Callable[[Any], bool], needed: str) -> BeforeValidator:
    """Refuses a value of another form in one sentence with an example."""

    def validate(value: Any) -> Any:
        if not fits(value):
            raise problem_error(f"{needed} is needed, not {value}")
        return value

    return BeforeValidator(validate)


def _m_of_n(value: Any) -> bool:
    return value in ("score", "existence") or (
        isinstance(value, list) and len(value) == 2 and {type(number) for number in value} == {int}
    )


class AssociateConfig(Config):
    """Tracks of several objects from detections that nobody labelled."""

    method: AssociationMethod = Field(
        description="gnn: global nearest neighbour. jpda: joint probabilistic data association. jipda: the same with "
        "existence probabilities. pmb: Poisson multi-Bernoulli filter. oracle: knows which object caused each "
        "detection. naive: each detection, in the order of the list, goes to the nearest track."
    )
    gate: Annotated[
        Fraction,
        _only(lambda value: not (isinstance(value, int | float) and value >= 1), "a probability, such as 0.9999,"),
    ] = Field(
        0.9999,
        description="Probability that an object's detection falls into the gate of its track (chi-square); not oracle.",
    )
    confirm: Annotated[
        Annotated[list[int], Field(min_length=2, max_length=2)] | Literal["score", "existence"] | None,
        _only(_m_of_n, "[M, N], such as [3, 5], score or existence"),
    ] = Field(
        None,
        description="[M, N], all methods: a track is confirmed with M detections in its first N scans, the one that "
        "started it included, and deleted as soon as it can no longer have them. score, gnn and jpda: by the logarithm "
        "of the likelihood ratio of object and false alarms. existence, jipda and pmb: by its probability. Unless "
        "given, [3, 5] for gnn, jpda and naive, existence for jipda and pmb, and at once, [1, 1], for oracle.",
    )
    confirm_score: float = Field(12, gt=0, description="With confirm: score. A track is confirmed at this score.")
    score_drop: Positive = Field(
        10, description="With confirm: score. A track is deleted when its score is this far below its largest."
    )
    delete_misses: Annotated[int, Field(ge=1, le=10_000)] | None = Field(
        None,
        description="gnn, jpda, oracle, naive. A confirmed track is deleted after this many scans in a row without a "
        "detection, of sensors in whose field of view it was; no such rule unless given.",
    )
    delete_after_s: Positive = Field(
        1,
        description="A track is deleted this long after its latest detection, s; several periods of the slowest "
        "sensor.",
    )
    confirm_existence: Fraction = Field(
        0.95,
        description="With confirm: existence. A track is reported once its probability of existence has reached this.",
    )
    end_existence: Fraction = Field(
        0.5, description="jipda and pmb. A track that was reported is deleted below this probability of existence."
    )
    delete_existence: Fraction = Field(
        1e-4, description="jipda and pmb. A track that was not reported yet is deleted below this."
    )
    lifetime_s: Positive = Field(
        60, description="jipda and pmb. Mean time that an object stays, s; existence fades at this rate."
    )
    visible_s: Positive | None = Field(
        10,
        description="jipda and pmb. Mean time until an object that stays is hidden, s; null: none ever is, and each "
        "scan without a detection speaks against its existence.",
    )
    hidden_s: Positive = Field(1, description="jipda and pmb. Mean time that a hidden object stays so, s.")
    birth_rate_hz: Positive = Field(
        0.2, description="jipda and pmb. Expected number of objects per second that come into the view of each sensor."
    )
    undetected: NonNegative = Field(
        10, description="jipda and pmb. Expected number of objects in the view of a sensor before its first scan."
    )
    max_cluster: int = Field(
        6,
        ge=0,
        le=12,
        description="jpda, jipda, pmb. Tracks and detections that compete form a cluster. With at most this many "
        "tracks, or detections if these are fewer, its association probabilities are exact; beyond, and with 0 in "
        "each cluster, by loopy belief propagation. pmb leaves out pairs of a weight up to 1e-4, which changes no "
        "probability by more than the sum of these weights.",
    )
    detection_probability: Annotated[
        dict[str, Probability],
        _only(lambda value: isinstance(value, dict), "one for each sensor's name, such as {radar: 0.9},"),
    ] = Field(
        default_factory=dict,
        description="For a sensor's name, the detection probability that the tracker takes in place of the stated one.",
    )
    clutter_density: Annotated[
        dict[str, Positive],
        _only(lambda value: isinstance(value, dict), "one for each sensor's name, such as {radar: 0.001},"),
    ] = Field(
        default_factory=dict,
        description="For a sensor's name, the false alarms per unit volume of its measurement space (m, rad, m/s) and "
        "scan that the tracker takes in place of the stated ones.",
    )

    @property
    def confirms_by(self) -> list[int] | Literal["score", "existence"]:
        """``confirm``, or what the method does unless it is given."""
        if self.confirm is not None:
            return self.confirm
        if self.method in EXISTENCE:
            return "existence"
        # With no false alarms to fear.
        return [1, 1] if self.method == "oracle" else [3, 5]

    @property
    def confirmation(self) -> str:
        """What confirms a track, in words."""
        rule = self.confirms_by
        return rule if isinstance(rule, str) else f"{rule[0]} of {rule[1]}"

    def problems(self) -> Iterator[Problem]:
        rule = self.confirms_by
        for key in (name for name in type(self).model_fields if name in self.model_fields_set):
            methods, of_rule = METHODS.get(key, (self.method,)), RULE_OF.get(key, rule)
            if self.method not in methods:
                yield Problem((key,), f"not used with method: {self.method}; remove it, or use {' or '.join(methods)}")
            elif rule != of_rule:
                yield Problem((key,), f"only used with confirm: {of_rule}; remove it, or write confirm: {of_rule}")
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
        for key in ("end_existence", "delete_existence"):
            if self.method in EXISTENCE and getattr(self, key) >= self.confirm_existence:
                yield Problem((key,), f"must be less than confirm_existence, which is {self.confirm_existence:g}")
