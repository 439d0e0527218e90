"""What a mutant is, and the subjects that faults are injected into."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

Make = Callable[[], Any]


@dataclass(frozen=True)
class Mutant:
    """A correct tracker with one fault."""

    fault: str
    subject: str
    """The correct tracker."""
    variant: str
    make: Make
    """A fresh tracker."""
    correct: Make
    """A fresh tracker without the fault, otherwise the same."""
    sensor: str | None = None
    """The kind of the only sensor that the fault concerns."""
    factor: float | None = None
    """Of r_too_small and r_too_large: the variance that the filter uses over that which the sensor states."""

    @property
    def name(self) -> str:
        return f"{self.fault}/{self.subject}/{self.variant}"


@dataclass(frozen=True)
class ExaminedTracker:
    """A correct tracker that takes ``start``, ``velocity_sigma``, ``acceleration_sigma`` and, where it turns,
    ``yaw_acceleration_sigma``."""

    name: str
    tracker: Callable[..., Any]
    turning: bool = False
    """Its state has speed, yaw and yaw rate."""
    uses_rate: bool = True
    """It takes in a radar's range rate."""

    def optioned(self, fault: str, variant: str, start: dict[str, Any] | None = None, **wrong: Any) -> Mutant:
        """The tracker with wrong options; ``start`` are options that the correct one has too."""
        correct = partial(self.tracker, **(start or {}))
        return Mutant(fault, self.name, variant, partial(correct, **wrong), correct)

    def behind(
        self,
        fault: str,
        variant: str,
        wrapper: Callable[..., Any],
        *arguments: Any,
        sensor: str | None = None,
        factor: float | None = None,
        options: dict[str, Any] | None = None,
    ) -> Mutant:
        """The correct tracker (with these options) in a wrapper."""
        correct = partial(self.tracker, **(options or {}))
        return Mutant(fault, self.name, variant, lambda: wrapper(correct(), *arguments), correct, sensor, factor)

    def mixed(self, fault: str, variant: str, mixin: type, sensor: str | None = None, **options: Any) -> Mutant:
        """The tracker's class with methods that override its own."""
        mutated = type(mixin.__name__, (mixin, self.tracker), {})
        correct = partial(self.tracker, **options)
        return Mutant(fault, self.name, variant, partial(mutated, **options), correct, sensor)
