"""What the truth audit found and did, as sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from trackbench.base.errors import counted
from trackbench.report.numbers import decimals, fixed, joined
from trackbench.results import TruthAudit, TruthSummary

#: m/s or m; what is smaller is not worth its digits.
_NEGLIGIBLE = 0.001

#: By scene; a single one has no name.
Audits = Mapping[str, TruthAudit]


def audit_sentences(truth: TruthSummary) -> list[str]:
    """The findings of ``trackbench.truth.audit`` in all scenes as sentences, the conclusion first."""
    of_scenes = {scene.name: scene.audit for scene in truth.scenes} or {"": truth.audit}
    audits = {name: audit for name, audit in of_scenes.items() if audit is not None}
    if not audits:
        return ["The truth was not audited."]
    return [_conclusion(audits), *_velocity(audits), *_velocity_jumps(audits), *_cuts(audits), *_clock(audits)]


def _conclusion(audits: Audits) -> str:
    repaired = [name for name, audit in audits.items() if audit.verdict == "repaired"]
    if len(repaired) == 1 == len(audits):
        return "The truth had faults, which were repaired before anything was scored."
    if repaired:
        share = f"{len(repaired)} of {len(audits)} scenes"
        return f"The truth of {share} had faults, which were repaired before anything was scored."
    if all(audit.verdict == "exact" for audit in audits.values()):
        return "The truth is exact: its velocities come from the same formulas as its positions."
    return "The truth is consistent: velocity agrees with displacement, no position jumps."


def _velocity(audits: Audits) -> Iterator[str]:
    scene, audit = max(audits.items(), key=lambda item: item[1].velocity_error_before.max_mps or 0.0)
    before, after, repaired = audit.velocity_error_before, audit.velocity_error_after, audit.repaired
    left = [item.velocity_error_after.max_mps for item in audits.values()]
    most = max((error for error in left if error is not None), default=None)
    if not before.max_mps or after.max_mps is None or most is None:
        return
    sources = {
        "course and slip angle": repaired.velocity_from_course_and_slip,
        "displacement": repaired.velocity_from_displacement,
    }
    if not any(sources.values()):
        yield f"The stated velocity differs from the displacement by {_at_most(most)} m/s."
        return
    how = joined([f"from {source} for {joined(names)}" for source, names in sources.items() if names])
    yield (
        f"The simulator's velocity contradicted the motion by up to {_two_digits(before.max_mps)} m/s "
        f"({_place(before.object, before.time_s, scene)}); it was computed {how}, which leaves {_at_most(most)} m/s."
    )


def _velocity_jumps(audits: Audits) -> Iterator[str]:
    found = {name: audit.velocity_jumps for name, audit in audits.items()}
    peak = max((jumps.peak_acceleration_mps2 or 0.0 for jumps in found.values()), default=0.0)
    count = sum(jumps.count for jumps in found.values())
    scene, worst = max(found.items(), key=lambda item: item[1].largest_mps or 0.0)
    if worst.largest_mps is None:
        if peak > 0:
            yield f"No velocity jumps: the largest acceleration is {_two_digits(peak)} m/s\N{SUPERSCRIPT TWO}."
        return
    yield (
        f"{counted(count, 'velocity jump')}: in one step the velocity changes by more than a car can do, which is put "
        f"at {worst.limit_mps2:g} m/s\N{SUPERSCRIPT TWO}, twice the grip of a tyre. The largest is "
        f"{_two_digits(worst.largest_mps)} m/s ({_place(worst.object, worst.time_s, scene)}), the peak acceleration "
        f"{fixed(peak, 0)} m/s\N{SUPERSCRIPT TWO}."
    )


def _cuts(audits: Audits) -> Iterator[str]:
    for scene, audit in audits.items():
        for jump in audit.jumps:
            if jump.object != "observer":
                when = f"at {fixed(jump.time_s, 2)} s{_of(scene)}"
                yield f"{jump.object} jumps by {_two_digits(jump.distance_m)} m {when}, and is left out from then on."
        if audit.ended_early is not None:
            end = fixed(audit.ended_early.time_s, 2)
            yield f"The truth{_of(scene)} ends at {end} s: {audit.ended_early.reason}."


def _clock(audits: Audits) -> Iterator[str]:
    drifts = [audit.clock_drift_s or 0.0 for audit in audits.values() if audit.repaired.own_clock]
    if drifts:
        drift = fixed(max(drifts), 3)
        yield f"The simulator's clock was off by up to {drift} s; time is counted from its steps instead."


def _place(name: str | None, time_s: float | None, scene: str) -> str:
    return f"{name} at {fixed(time_s, 2)} s{_of(scene)}"


def _of(scene: str) -> str:
    return f" of {scene}" if scene else ""


def _at_most(value: float) -> str:
    return f"less than {_NEGLIGIBLE:g}" if value < _NEGLIGIBLE else f"at most {_two_digits(value)}"


def _two_digits(value: float) -> str:
    return fixed(value, decimals([value], 2))
