"""The check-up of a tracker on short synthetic drives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

from pydantic import ValidationError

from trackbench.base.config.messages import explain
from trackbench.base.errors import InputError
from trackbench.driving.faults import TrackFault
from trackbench.driving.isolation import ISOLATED, is_program
from trackbench.driving.program import Program, ProgramTracker
from trackbench.testing.rules import (
    OF_OTHER_KIND,
    ONE,
    RULES,
    SEVERAL,
    STATE_KEPT,
    Identities,
    Make,
    Rule,
    TrackerCheckError,
    answers,
    gives_reports,
    require_identities,
)
from trackbench.trackers.answers import TrackerFault, is_random
from trackbench.trackers.config import PluginConfig
from trackbench.trackers.published import create


@dataclass(frozen=True)
class Check:
    """One rule and whether the tracker keeps it."""

    rule: str
    problem: str | None
    """None where it is kept."""


def check_tracker(
    use: str | Mapping[str, Any] | Callable[..., Any], *, identities: Identities = "known", **options: Any
) -> list[Check]:
    """Try a tracker on short synthetic drives, as the bench would use it.

    Args:
        use: its class, a published name or ``"module:Class"``; of a program ``{"command": ["./my_tracker"]}``, as
            a scenario in the working directory names it.
        identities: ``hidden`` for a tracker of several objects, whose detections say nothing of their origin.
        options: what a scenario would give it.

    Returns:
        Every rule, all of them kept; of a tracker that draws random numbers (``random = True``) those that this allows.

    Raises:
        TrackerCheckError: rules are broken; says which and how.
        InputError: the tracker cannot be imported or started, or ``identities`` is another word.
    """
    require_identities(identities)
    with ExitStack() as programs:
        make = _maker(use, identities, options, programs)
        rules, repeating = RULES[identities]
        chosen = rules if _draws(make) else rules | repeating
        # The state of a program is in the program, which is not given one.
        kept_there = STATE_KEPT if isinstance(use, Mapping) else None
        checks = [Check(rule, _problem(test, make)) for rule, test in chosen.items() if rule != kept_there]
        broken: dict[str, list[str]] = {}
        for check in checks:
            if check.problem:
                broken.setdefault(check.problem, []).append(check.rule)
        if broken and _is_of_other_kind(make, identities):
            raise TrackerCheckError(OF_OTHER_KIND[identities])
    if broken:
        # A cause that breaks several rules is told once.
        lines = [f"- {'; '.join(names)}: {problem}" for problem, names in broken.items()]
        raise TrackerCheckError("the tracker breaks these rules:\n" + "\n".join(lines))
    return checks


def _maker(
    use: str | Mapping[str, Any] | Callable[..., Any],
    identities: Identities,
    options: dict[str, Any],
    programs: ExitStack,
) -> Make:
    """Return what makes fresh trackers; a program that serves them ends with ``programs``."""
    if callable(use):
        return partial(use, **options)
    try:
        config = PluginConfig.model_validate({"use": use, "options": options})
    except ValidationError as invalid:
        raise InputError(explain(invalid, {})[0].message, key="use") from None
    if not is_program(config):
        return create(config.reference, config.options)
    try:
        program = Program(config, None, ISOLATED, identities == "hidden")
    except TrackFault as fault:
        raise InputError(f"cannot start {str(config.use)!r}: {fault}", key="use") from fault
    programs.callback(program.close)
    return partial(ProgramTracker, program)


def _draws(make: Make) -> bool:
    try:
        return is_random(make())
    except (Exception, SystemExit):
        return False


def _is_of_other_kind(make: Make, identities: Identities) -> bool:
    def answers_of(kind: Any) -> Iterator[bool]:
        return (len(tracks.ids) > 0 for tracks in answers(kind, make, kind.drive()))

    own, other = (ONE, SEVERAL) if identities == "known" else (SEVERAL, ONE)
    return not gives_reports(lambda: answers_of(own)) and gives_reports(lambda: answers_of(other))


def _problem(test: Rule, make: Make) -> str | None:
    try:
        test(make)
    except (TrackerFault, TrackerCheckError) as fault:
        return str(fault)
    except (Exception, SystemExit) as error:
        return f"{type(error).__name__}: {error}"
    return None
