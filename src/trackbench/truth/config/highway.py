"""Options of traffic simulated by highway-env."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, Tag

from trackbench.base.config import (
    LIST,
    MAPPING,
    NUMBER,
    WORD,
    Config,
    Positive,
    Problem,
    chosen_by,
    number_or_list,
    shape,
)
from trackbench.truth.base import MAX_SCENES, SteppedTruth, distinct
from trackbench.truth.config.recording import FixedObserver

LARGEST_SEED = 2**32 - 1


class SelectedTargets(Config):
    """Targets chosen by distance or by name."""

    nearest: int | None = Field(
        None, ge=1, le=1000, description="How many vehicles to track: those that come closest to the observer."
    )
    ids: list[str] | None = Field(None, min_length=1, description="Names of the vehicles to track, such as v1.")

    def problems(self) -> Iterator[Problem]:
        if (self.nearest is None) == (self.ids is None):
            yield Problem((), "write either nearest or ids")


class VehicleSizes(Config):
    """Shares of the vehicles that are longer than highway-env's 5 m x 2 m.

    The motion does not change: highway-env drives and checks collisions with its own size.
    """

    van: float = Field(0, ge=0, le=1, description="Share that is 7 m x 2 m, 0 to 1.")
    truck: float = Field(0, ge=0, le=1, description="Share that is 10 m x 2.5 m, 0 to 1.")

    def problems(self) -> Iterator[Problem]:
        if self.van + self.truck > 1:
            yield Problem((), f"the shares add up to {self.van + self.truck:g}; at most 1 is possible")


Observer = Annotated[
    Annotated[Literal["ego"], Tag(WORD)] | Annotated[FixedObserver, Tag(MAPPING)],
    chosen_by(shape, "write ego or {x: 0, y: 0, yaw_deg: 0}"),
]
Targets = Annotated[
    Annotated[Literal["all"], Tag(WORD)] | Annotated[SelectedTargets, Tag(MAPPING)],
    chosen_by(shape, "write all, {nearest: 4} or {ids: [v1, v2]}"),
]


Seed = Annotated[int, Field(ge=0, le=LARGEST_SEED)]
Seeds = Annotated[
    Annotated[int, Field(ge=1, le=MAX_SCENES), Tag(NUMBER)]
    | Annotated[list[Seed], Field(min_length=1, max_length=MAX_SCENES), AfterValidator(distinct), Tag(LIST)],
    chosen_by(number_or_list, "write a number of scenes, such as 20, or a list of seeds, such as [3, 5]"),
]


ChosenTargets = Annotated[
    Targets,
    Field(
        description="Which vehicles are tracked: all, the {nearest: N} that come closest to the observer, or "
        "{ids: [...]}."
    ),
]


class HighwayOptions(SteppedTruth):
    """Traffic simulated by highway-env."""

    env: str = Field(
        min_length=1, description="A registered highway-env id, such as highway-v0 (`trackbench list envs` shows them)."
    )
    config: dict[str, Any] = Field(
        default_factory=dict,
        description="The environment's own configuration, checked by highway-env; an unknown key is refused.",
    )
    seed: Seed = Field(0, description="Seed of the traffic; of the first scene, where `seeds` is a number.")
    seeds: Seeds | None = Field(
        None,
        description="Several scenes: how many, with the seeds from `seed` on, or a list of their seeds. At most "
        f"{MAX_SCENES}.",
    )
    observer: Observer = Field(
        "ego", description="What carries the sensors: the ego vehicle, or a fixed point {x, y, yaw_deg}."
    )
    targets: ChosenTargets = "all"
    ego: Literal["idle", "idm"] = Field(
        "idm",
        description="Who drives the ego vehicle: the environment's neutral action (idle), or the driver "
        "model of the other cars (idm: IDM with MOBIL lane changes).",
    )
    steering_rate_degps: Positive | None = Field(
        None,
        description="Largest rate at which the front wheels of all vehicles turn, degrees per second. Unless given "
        "they turn in no time, as highway-env's do, and velocities jump.",
    )
    drivers: Literal["steady", "human"] = Field(
        "steady",
        description="How the drivers vary: not at all (steady, as highway-env's do), or as fitted to recorded traffic "
        "(human).",
    )
    sizes: VehicleSizes | None = Field(
        None, description="Shares of the vehicles with the size of vans and trucks, drawn from the seed."
    )

    @property
    def scene_name(self) -> str:
        return f"seed {self.seed}"

    def scenes(self) -> Sequence[Self]:
        if self.seeds is None:
            return (self,)
        seeds = self.seeds if isinstance(self.seeds, list) else range(self.seed, self.seed + self.seeds)
        return tuple(self.model_copy(update={"seed": seed, "seeds": None}) for seed in seeds)

    def problems(self) -> Iterator[Problem]:
        if isinstance(self.seeds, int) and self.seed + self.seeds - 1 > LARGEST_SEED:
            yield Problem(("seeds",), f"the last of them would be above {LARGEST_SEED}; lower seed or seeds")
        if isinstance(self.seeds, list) and "seed" in self.model_fields_set:
            yield Problem(("seed",), "not used with a list of seeds; remove it, or write in seeds how many there are")
