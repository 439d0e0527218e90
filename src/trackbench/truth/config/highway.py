"""Traffic simulated by highway-env."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from trackbench.config import MAPPING, PROBLEM, WORD, Config, shape
from trackbench.truth.base import SteppedTruth
from trackbench.truth.config.observer import FixedObserver


class NearestTargets(Config):
    """The vehicles that come closest to the observer."""

    nearest: int = Field(ge=1, le=1000, description="How many vehicles to track.")


class IdTargets(Config):
    """Vehicles by name."""

    ids: list[str] = Field(min_length=1, description="Names of the vehicles to track, such as v1.")


def _target_choice(value: Any) -> str | None:
    if isinstance(value, NearestTargets) or (isinstance(value, dict) and "nearest" in value):
        return "<nearest>"
    if isinstance(value, IdTargets) or (isinstance(value, dict) and "ids" in value):
        return "<ids>"
    return WORD if isinstance(value, str) else None


Observer = Annotated[
    Annotated[Literal["ego"], Tag(WORD)] | Annotated[FixedObserver, Tag(MAPPING)],
    Discriminator(shape, custom_error_type=PROBLEM, custom_error_message="write ego or {x: 0, y: 0, yaw_deg: 0}"),
]
Targets = Annotated[
    Annotated[Literal["all"], Tag(WORD)]
    | Annotated[NearestTargets, Tag("<nearest>")]
    | Annotated[IdTargets, Tag("<ids>")],
    Discriminator(
        _target_choice,
        custom_error_type=PROBLEM,
        custom_error_message="write all, {nearest: 4} or {ids: [v1, v2]}",
    ),
]


class HighwayOptions(SteppedTruth):
    """Traffic simulated by highway-env."""

    env: str = Field(
        min_length=1,
        description="A registered highway-env id, such as highway-v0 (`trackbench list envs` shows them).",
    )
    config: dict[str, Any] = Field(
        default_factory=dict, description="The environment's own configuration; unknown keys are refused."
    )
    seed: int = Field(0, ge=0, le=2**32 - 1, description="Seed of the traffic.")
    observer: Observer = Field(
        "ego", description="What carries the sensors: the ego vehicle, or a fixed point {x, y, yaw_deg}."
    )
    targets: Targets = Field(
        "all",
        description="Which vehicles are tracked: all, the {nearest: N} that come closest to the observer, or "
        "{ids: [...]}.",
    )
    ego: Literal["idle", "idm"] = Field(
        "idm",
        description="Who drives the ego vehicle: the environment's neutral action (idle), or the driver "
        "model of the other cars (idm: IDM with MOBIL lane changes).",
    )
    audit: Literal["repair", "refuse"] = Field(
        "repair", description="What to do where the simulated velocity contradicts the simulated motion."
    )
