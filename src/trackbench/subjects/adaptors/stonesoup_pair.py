"""A predictor and an updater of Stone Soup, and the options held against them."""

from __future__ import annotations

from typing import Any

from stonesoup.models.base import TimeInvariantModel
from stonesoup.models.measurement import MeasurementModel
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.state import GaussianState, SqrtGaussianState
from stonesoup.updater.kalman import KalmanUpdater

from trackbench.base.errors import InputError
from trackbench.subjects.adaptors.options import OWN
from trackbench.subjects.adaptors.stonesoup_options import StoneSoupOptions


def require_pair(found: Any, options: StoneSoupOptions) -> tuple[Any, Any, Any]:
    """Predictor, updater and, where there is one, the first state.

    Raises:
        InputError: they are something else, or the options do not fit them.
    """
    kinds: tuple[Any, ...] = (KalmanPredictor, KalmanUpdater, (GaussianState, SqrtGaussianState))
    sizes = isinstance(found, tuple | list) and len(found) in (2, 3)
    if not sizes or not all(isinstance(item, kind) for item, kind in zip(found, kinds, strict=False)):
        what = "a KalmanPredictor, a KalmanUpdater and, where the track starts from it, a GaussianState"
        shown = ", ".join(type(item).__name__ for item in found) if sizes else type(found).__name__
        raise InputError(f"pair: {options.pair!r} gives {shown}, not {what}")
    predictor, updater, first = (*found, None)[:3]
    named = len(options.state)
    if predictor.transition_model.ndim_state != named:
        size = predictor.transition_model.ndim_state
        raise InputError(f"state: names {named} components, but the transition model's state has {size}")
    if first is not None and first.ndim != named:
        raise InputError(f"state: names {named} components, but the first state has {first.ndim}")
    if first is None and (options.initial is None or "other" in options.state):
        why = "initial: own" if options.initial is None else "a component named other"
        raise InputError(f"pair: {options.pair!r} gives no first state (a GaussianState), which {why} needs")
    fixed = _fixed(predictor.transition_model)
    if fixed and options.dt_s is None:
        raise InputError("dt_s: missing: the transition model is time-invariant; say for which interval it holds (s)")
    if not fixed and options.dt_s is not None:
        raise InputError("dt_s: not used: the transition model takes any interval; remove it")
    if updater.measurement_model is None:
        for name, sensor in (options.sensors or {}).items():
            if sensor.measurement_model == OWN:
                raise InputError(f"sensors.{name}.measurement_model: the updater has none of its own; name one")
    return predictor, updater, first


def require_model(found: Any, option: str, reference: str, size: int) -> Any:
    """A measurement model, or a function of a scan that gives one.

    Raises:
        InputError: it is neither, or of another state.
    """
    if isinstance(found, MeasurementModel):
        if found.ndim_state != size:
            raise InputError(f"{option}: {reference!r} is of a state of {found.ndim_state} components, not {size}")
    elif isinstance(found, type) or not callable(found):
        raise InputError(f"{option}: {reference!r} is no MeasurementModel and no function of a scan that gives one")
    return found


def _fixed(model: Any) -> bool:
    """Whether a transition model, or a part of it, is the same for every interval."""
    return isinstance(model, TimeInvariantModel) or any(_fixed(part) for part in getattr(model, "model_list", ()))
