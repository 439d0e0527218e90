"""The check of a tracker on short synthetic drives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
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


def check_tracker(
    use: str | Mapping[str, Any] | Callable[..., Any], *, identities: Identities = "known", **options: Any
) -> list[str]:
    """Check a tracker on short synthetic drives, used as in the bench.

    Args:
        use: class of the tracker, a published name or ``"module:Class"``; for a program ``{"command":
            ["./my_tracker"]}``, with a path from the working directory.
        identities: ``hidden`` for a tracker of several objects, ``known`` for one object.
        options: options that a scenario would set.

    Returns:
        The rules that the tracker keeps; with ``random = True`` only the rules that allow random answers.

    Raises:
        TrackerCheckError: a rule is broken; the text lists all broken rules.
        InputError: the tracker cannot be imported or started, or ``identities`` is invalid.
    """
    require_identities(identities)
    with ExitStack() as programs:
        make = _maker(use, identities, options, programs)
        rules, repeating = RULES[identities]
        chosen = rules if _draws(make) else rules | repeating
        # A program keeps its state itself, so that the rule on a passed state does not apply.
        skipped_rule = STATE_KEPT if isinstance(use, Mapping) else None
        applied = [rule for rule in chosen if rule != skipped_rule]
        broken: dict[str, list[str]] = {}
        for rule in applied:
            if problem := _problem(chosen[rule], make):
                broken.setdefault(problem, []).append(rule)
        if broken and _is_of_other_kind(make, identities):
            raise TrackerCheckError(OF_OTHER_KIND[identities])
    if broken:
        # A problem that breaks several rules has one line.
        lines = [f"- {'; '.join(names)}: {problem}" for problem, names in broken.items()]
        raise TrackerCheckError("the tracker breaks these rules:\n" + "\n".join(lines))
    return applied


def _maker(
    use: str | Mapping[str, Any] | Callable[..., Any],
    identities: Identities,
    options: dict[str, Any],
    programs: ExitStack,
) -> Make:
    """Return the function that makes fresh trackers; a program behind them ends with ``programs``."""
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

    stated, other = (ONE, SEVERAL) if identities == "known" else (SEVERAL, ONE)
    return not gives_reports(lambda: answers_of(stated)) and gives_reports(lambda: answers_of(other))


def _problem(test: Rule, make: Make) -> str | None:
    try:
        test(make)
    except (TrackerFault, TrackerCheckError) as fault:
        return str(fault)
    except (Exception, SystemExit) as error:
        return f"{type(error).__name__}: {error}"
    return None
