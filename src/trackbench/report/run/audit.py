"""What the truth audit found and did, as sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trackbench.report.numbers import decimals, fixed, joined

#: m/s or m; what is smaller is not worth its digits.
_NEGLIGIBLE = 0.001


def audit_sentences(audit: Mapping[str, Any]) -> list[str]:
    """The findings of ``trackbench.truth.audit`` as sentences, the conclusion first; none where there was no audit."""
    if not audit:
        return ["The truth was not audited."]
    sentences = [
        {
            "consistent": "The truth is consistent: velocity agrees with displacement, nothing jumps.",
            "exact": "The truth is exact: its velocities come from the same formulas as its positions.",
            "repaired": "The truth had faults, which were repaired before anything was scored.",
        }.get(str(audit.get("verdict")), f"Audit: {audit.get('verdict')}.")
    ]
    sentences += _velocity(audit)
    sentences += [
        f"{jump['object']} jumps by {_two_digits(jump['distance_m'])} m at {fixed(jump['time_s'], 2)} s, and is left "
        "out from then on."
        for jump in audit.get("jumps", ())
        if jump["object"] != "observer"
    ]
    ended = audit.get("ended_early")
    if ended:
        sentences.append(f"The truth ends at {fixed(ended['time_s'], 2)} s: {ended['reason']}.")
    if audit.get("repaired", {}).get("own_clock"):
        drift = fixed(audit["clock_drift_s"], 3)
        sentences.append(f"The simulator's clock was off by up to {drift} s; time is counted from its steps instead.")
    return sentences


def _velocity(audit: Mapping[str, Any]) -> list[str]:
    before, after = audit.get("velocity_error_before", {}), audit.get("velocity_error_after", {})
    if not before.get("max_mps") or after.get("max_mps") is None:
        return []
    repaired = audit.get("repaired", {})
    sources = {
        "course and slip angle": repaired.get("velocity_from_course_and_slip", []),
        "displacement": repaired.get("velocity_from_displacement", []),
    }
    if not any(sources.values()):
        return [f"The stated velocity differs from the displacement by {_at_most(after['max_mps'])} m/s."]
    how = joined([f"from {source} for {joined(names)}" for source, names in sources.items() if names])
    return [
        f"The simulator's velocity contradicted the motion by up to {_two_digits(before['max_mps'])} m/s "
        f"({before['object']} at {fixed(before['time_s'], 2)} s); it was computed {how}, which leaves "
        f"{_at_most(after['max_mps'])} m/s."
    ]


def _at_most(value: float) -> str:
    return f"less than {_NEGLIGIBLE:g}" if value < _NEGLIGIBLE else f"at most {_two_digits(value)}"


def _two_digits(value: float) -> str:
    return fixed(value, decimals([value], 2))
