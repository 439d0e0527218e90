"""Which trackers get a process of their own."""

from __future__ import annotations

from dataclasses import dataclass

from trackbench.base.errors import InputError
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.published import built_in

#: A day, s.
LONGEST = 86_400.0


def plugged_in(config: FilterConfig | PluginConfig) -> bool:
    """Whether a tracker is not built in."""
    return isinstance(config, PluginConfig) and not built_in(config.use)


@dataclass(frozen=True)
class Isolation:
    """How trackers that are not built in are kept apart from the bench."""

    in_process: bool = False
    """Whether they are not: for a debugger."""
    timeout: float = 300.0
    """The longest that one may take for a step, s."""

    def __post_init__(self) -> None:
        if not 0.0 < self.timeout <= LONGEST:
            problem = f"{self.timeout!r} is no time; give a number of seconds above 0, at most {LONGEST:g}"
            raise InputError(problem, key="tracker_timeout")

    def of(self, config: FilterConfig | PluginConfig) -> bool:
        """Whether a tracker gets a process of its own."""
        return plugged_in(config) and not self.in_process


ISOLATED = Isolation()
