"""How the drivers of simulated traffic differ from one another, and from themselves a second ago."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, Tag

from trackbench.base.config import MAPPING, WORD, Config, Positive, Problem, chosen_by, shape


class Drivers(Config):
    """Drivers who vary; each effect is off unless it is stated.

    Each driver has a random stream of its own, from the seed of the traffic and the number of its vehicle.
    """

    acceleration_rms_mps2: float = Field(
        0, ge=0, le=3, description="Acceleration that a driver adds to that of the model: a Gauss-Markov process, rms."
    )
    acceleration_full_mps: Positive = Field(
        2, description="Speed from which on it has this size. Below, the size is in proportion to the speed."
    )
    acceleration_time_s: float = Field(1, ge=0.05, le=60, description="Its correlation time, to 1/e.")
    wander_m: float = Field(0, ge=0, le=1, description="Distance of the car from where its lane leads it, rms.")
    wander_time_s: float = Field(
        5,
        ge=0.05,
        le=60,
        description="Correlation time of the place in the lane that the driver steers for: a "
        "Gauss-Markov process, which the car follows.",
    )
    reaction_s: float = Field(
        0,
        ge=0,
        le=2,
        description="Delay of the braking for the vehicle ahead: all of the model's interaction, of the gap and both "
        "speeds, is of so long ago.",
    )
    speed_spread: float = Field(
        0, ge=0, le=0.3, description="Standard deviation over drivers of the desired speed, relative to its mean."
    )
    headway_s: list[Annotated[float, Field(gt=0, le=5)]] | None = Field(
        None,
        min_length=2,
        max_length=2,
        description="Least and most time gap that a driver keeps, uniform; highway-env's 1.5 s unless given.",
    )
    cornering_mps2: Positive | None = Field(
        None, description="Largest acceleration across at which a driver takes a bend, for which it brakes in time."
    )
    grip_mps2: Positive | None = Field(
        None, description="Largest acceleration of the tyres, along and across together."
    )
    jerk_mps3: Positive | None = Field(
        None,
        description="Largest rate of change of the acceleration that the driver wants, before acceleration_rms_mps2 is "
        "added and grip and standing limit it.",
    )
    steering_rate_degps: Positive = Field(
        30, description="Rate of the front wheels, degrees per second, where truth.steering_rate_degps is not given."
    )

    def problems(self) -> Iterator[Problem]:
        if self.headway_s is not None and self.headway_s[0] > self.headway_s[1]:
            yield Problem(("headway_s",), f"the least, {self.headway_s[0]:g}, is above the most, {self.headway_s[1]:g}")


#: Acceleration and wander are fitted to recorded traffic; the other values have their sources in docs/drivers.md.
HUMAN = Drivers(
    acceleration_rms_mps2=0.52,
    acceleration_full_mps=10,
    acceleration_time_s=0.8,
    wander_m=0.18,
    wander_time_s=0.4,
    reaction_s=0.7,
    speed_spread=0.08,
    headway_s=[1.0, 2.7],
    cornering_mps2=3.0,
    grip_mps2=7.8,
    jerk_mps3=15,
)

DriversChoice = Annotated[
    Annotated[Literal["steady", "human"], Tag(WORD)] | Annotated[Drivers, Tag(MAPPING)],
    chosen_by(shape, "write steady, human, or a mapping such as {acceleration_rms_mps2: 0.25}"),
]
