"""Options of scripted motion, a sequence of pieces for each body."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Field, Tag

from trackbench.base.config import (
    MAPPING,
    Angle,
    Config,
    KeyPath,
    Name,
    NonNegative,
    Positive,
    Problem,
    chosen_by,
    shape,
)
from trackbench.base.config.plugin import OptionsBeside, Plugin
from trackbench.models.motion import MOTION_MODELS, ConstantVelocity, MotionModel
from trackbench.truth.base import SteppedTruth
from trackbench.truth.config.recording import MovingObserver
from trackbench.truth.jumps import Position, Speed, Velocity

#: Default kind of motion of a piece: constant turn rate and acceleration.
STEADY = "steady motion"
#: Keys of each kind of motion of a piece.
KINDS: dict[str, tuple[str, ...]] = {
    "white": (),
    "white_acceleration": (),
    "waypoints": ("speed_mps",),
    STEADY: ("turn_rate_degps", "acceleration_mps2", "until_stop"),
}

Waypoint = Annotated[list[Position], Field(min_length=2, max_length=2)]


class ScriptedStart(Config):
    """Position and velocity of a body at the start; the velocity by speed and course, or by components."""

    x: Position = Field(0, description="Position along x in the fixed frame, m.")
    y: Position = Field(0, description="Position along y in the fixed frame, m.")
    speed_mps: Speed | None = Field(None, description="Speed along the course, m/s; 0 unless given.")
    course_deg: Angle | None = Field(
        None, description="Direction of motion in the fixed frame, counter-clockwise from x, degrees; 0 unless given."
    )
    vx_mps: Velocity | None = Field(None, description="Velocity along x, m/s; instead of speed_mps and course_deg.")
    vy_mps: Velocity | None = Field(None, description="Velocity along y, m/s; instead of speed_mps and course_deg.")

    def problems(self) -> Iterator[Problem]:
        if {self.speed_mps, self.course_deg} != {None} and {self.vx_mps, self.vy_mps} != {None}:
            yield Problem((), "the velocity is given twice: write speed_mps and course_deg, or vx_mps and vy_mps")


class WhiteMotion(OptionsBeside):
    """Motion model driven by its own noise, drawn anew in each run and at each truth step."""

    motion: Annotated[MotionModel, Plugin(MOTION_MODELS, "model", word=True)] = Field(
        description="The motion model (`trackbench list motion-models` shows them), or one of your own as "
        "`module:Class`. Its options stand beside it."
    )


class WhiteAcceleration(Config):
    """Acceleration along the axes of the fixed frame, drawn anew in each run and at each truth step."""

    x_sigma_mps2: NonNegative = Field(0, description="Standard deviation of the acceleration along x, m/s^2.")
    y_sigma_mps2: NonNegative = Field(0, description="Standard deviation of the acceleration along y, m/s^2.")


class Piece(Config):
    """Stretch of one kind of motion, which starts where the previous piece ends.

    Without other keys the motion is straight and steady. In random motion the noise is constant over each truth step,
    as in the trackers' motion models. So a tracker that reads a sensor at every truth step has the process noise of the
    truth.
    """

    for_s: Positive | None = Field(
        None, description="How long it lasts, s; a whole number of truth steps. The last piece may leave it out."
    )
    turn_rate_degps: float = Field(
        0, ge=-720, le=720, description="Constant turn rate, counter-clockwise, degrees per second."
    )
    acceleration_mps2: float = Field(
        0,
        ge=-1000,
        le=1000,
        description="Constant acceleration along the path, m/s^2; below a speed of zero the object reverses.",
    )
    until_stop: bool = Field(
        False,
        description="For a negative acceleration: whether the object stands still once its speed is zero, until the "
        "end of the piece, instead of reversing.",
    )
    white: WhiteMotion | None = Field(None, description="Random motion: a motion model driven by its own noise.")
    white_acceleration: WhiteAcceleration | None = Field(
        None, description="Random motion: constant velocity, with an acceleration of its own size on each axis."
    )
    waypoints: list[Waypoint] | None = Field(
        None,
        min_length=1,
        description="Points [x, y] in the fixed frame, m, on the way through which the object goes straight from one "
        "to the next, and straight on after the last.",
    )
    speed_mps: Annotated[Speed, Field(gt=0)] | None = Field(
        None, description="Speed along the waypoints, m/s; that at the end of the piece before unless given."
    )

    @property
    def random(self) -> bool:
        """Whether the motion differs from run to run."""
        return self.white is not None or self.white_acceleration is not None

    @property
    def acceleration_sigma(self) -> float | None:
        """Standard deviation of white acceleration, m/s^2; 0 for steady motion; None for any other motion."""
        if self.white is not None:
            motion = self.white.motion
            return motion.acceleration_sigma_mps2 if isinstance(motion, ConstantVelocity) else None
        if self.white_acceleration is not None:
            x, y = self.white_acceleration.x_sigma_mps2, self.white_acceleration.y_sigma_mps2
            return x if x == y else None
        steady = self.waypoints is None and self.turn_rate_degps == self.acceleration_mps2 == 0
        return 0.0 if steady else None

    def problems(self) -> Iterator[Problem]:
        kind = next((kind for kind in KINDS if getattr(self, kind, None) is not None), STEADY)
        for key in sorted(self.model_fields_set - {"for_s", kind, *KINDS[kind]}):
            yield Problem((key,), f"a piece has one kind of motion, and this one has {kind}; write another piece")
        if self.until_stop and self.acceleration_mps2 >= 0:
            yield Problem(("until_stop",), "only used with a negative acceleration_mps2")


class ScriptedBody(Config):
    """Body with its scripted motion."""

    start: ScriptedStart = Field(default_factory=ScriptedStart, description="Position and velocity at the start.")
    length_m: Positive = Field(4.5, description="Length, m, to draw it and to hide others.")
    width_m: Positive = Field(1.8, description="Width, m, to draw it and to hide others.")
    pieces: list[Piece] = Field(
        default_factory=lambda: [Piece()],
        min_length=1,
        description="Its motion, one piece after the other; straight and steady unless given.",
    )

    @property
    def random(self) -> bool:
        """Whether the motion differs from run to run."""
        return any(piece.random for piece in self.pieces)


class ScriptedObject(ScriptedBody):
    """Object with its scripted motion."""

    target: bool = Field(
        True, description="Whether it is tracked; false needs hidden identities, where it still causes detections."
    )


class ScriptedObserver(ScriptedBody):
    """Vehicle that carries the sensors and drives like an object; it points where it drives."""

    length_m: Positive = Field(5.0, description="Length, m.")
    width_m: Positive = Field(2.0, description="Width, m.")

    def problems(self) -> Iterator[Problem]:
        for index, piece in enumerate(self.pieces):
            if piece.random:
                yield Problem(("pieces", index), "the observer drives alike in every run: no random motion")


def _observer_kind(value: Any) -> str | None:
    if isinstance(value, dict):
        return "<drive>" if value.keys() & ScriptedObserver.model_fields.keys() else MAPPING
    return "<drive>" if isinstance(value, ScriptedObserver) else shape(value)


Observer = Annotated[
    Annotated[MovingObserver, Tag(MAPPING)] | Annotated[ScriptedObserver, Tag("<drive>")],
    chosen_by(
        _observer_kind,
        "write a point {x: 0, y: 0, yaw_deg: 0, vx_mps: 20}, or a vehicle "
        "{start: {speed_mps: 20}, pieces: [...], length_m: 5, width_m: 2}",
    ),
]


class ScriptedOptions(SteppedTruth):
    """Options of scripted motion, exact in position and velocity."""

    observer: Observer = Field(
        default_factory=MovingObserver, description="What carries the sensors: a point, or a vehicle that drives."
    )
    objects: dict[Name, ScriptedObject] = Field(min_length=1, description="The objects, by name.")

    @property
    def random(self) -> bool:
        """Whether any motion differs from run to run."""
        return any(body.random for body in self.objects.values())

    @property
    def white_acceleration(self) -> float | None:
        sigmas = {piece.acceleration_sigma for body in self.objects.values() for piece in body.pieces}
        return sigmas.pop() if len(sigmas) == 1 else None

    def problems(self) -> Iterator[Problem]:
        if not any(body.target for body in self.objects.values()):
            yield Problem(("objects",), "no object is a target; leave target out of one")
        bodies: dict[KeyPath, ScriptedBody] = {("objects", name): body for name, body in self.objects.items()}
        if isinstance(self.observer, ScriptedObserver):
            bodies["observer",] = self.observer
        for key, body in bodies.items():
            for problem in self._duration_problems(body.pieces):
                yield Problem((*key, "pieces", *problem.at), problem.message)

    def _duration_problems(self, pieces: list[Piece]) -> Iterator[Problem]:
        last, is_valid = len(pieces) - 1, True
        for index, piece in enumerate(pieces):
            steps = None if piece.for_s is None else piece.for_s * self.rate_hz
            if steps is None and index < last:
                yield Problem((index, "for_s"), "missing; only the last piece may leave it out")
                is_valid = False
            elif steps is not None and (abs(steps - round(steps)) > 1e-6 or round(steps) == 0):
                near = f"{max(1, round(steps)) / self.rate_hz:g}"
                message = f"must be a multiple of the truth step, which is {1 / self.rate_hz:g} s; use {near}"
                yield Problem((index, "for_s"), message)
                is_valid = False
        pieces_s = sum(piece.for_s or 0.0 for piece in pieces)
        rest_s, is_open = self.duration_s - pieces_s, pieces[last].for_s is None
        if is_valid and (rest_s < 1e-6 if is_open else abs(rest_s) > 1e-6):
            message = f"pieces last {pieces_s:g} s, but truth.duration_s is {self.duration_s:g}"
            yield Problem((last,) if is_open else (last, "for_s"), message)
