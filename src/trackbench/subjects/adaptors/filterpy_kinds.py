"""What each class of FilterPy's filters takes, and the options held against it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter, UnscentedKalmanFilter

from trackbench.base.errors import InputError
from trackbench.base.types import Array
from trackbench.subjects.adaptors.layout import POSITION, Layout, Reader
from trackbench.subjects.adaptors.options import OWN, FilterPyOptions, FilterPySensor, function


class Kind(NamedTuple):
    """What one class of filters takes."""

    own: Mapping[str, str]
    """Its matrices that hold for one interval only, each with the option that replaces it by a function of dt."""
    options: tuple[str, ...]
    sensor: tuple[str, ...]


COMMON = ("filter", "filter_options", "state", "initial", "dt_s", "process_noise", "sensors")
MATRICES = {"F": "transition", "Q": "process_noise"}
KINDS: dict[type, Kind] = {
    KalmanFilter: Kind(MATRICES, ("transition",), ("measurement", "R")),
    ExtendedKalmanFilter: Kind(
        MATRICES, ("transition", "fx"), ("measurement", "R", "hx", "HJacobian", "residual", "args")
    ),
    UnscentedKalmanFilter: Kind({"Q": "process_noise"}, (), ("measurement", "R", "hx", "residual", "z_mean", "args")),
}


def kind_of(found: Any, options: FilterPyOptions) -> type:
    """The class of a filter, the options held against it.

    Raises:
        InputError: it is no filter that this adaptor knows, or an option does not go with it.
    """
    kind = next((kind for kind in KINDS if isinstance(found, kind)), None)
    if kind is None:
        known = ", ".join(kind.__name__ for kind in KINDS)
        raise InputError(f"filter: {options.filter!r} gives a {type(found).__name__}, not one of {known}")
    takes = KINDS[kind]
    _only(options.model_fields_set, (*COMMON, *takes.options), kind, "")
    for name, sensor in (options.sensors or {}).items():
        _only(sensor.model_fields_set, takes.sensor, kind, f"sensors.{name}.")
        if kind is ExtendedKalmanFilter and (sensor.hx is None) != (sensor.HJacobian is None):
            missing = "hx" if sensor.hx is None else "HJacobian"
            raise InputError(f"sensors.{name}.{missing}: missing: an ExtendedKalmanFilter needs hx and HJacobian")
        if kind is ExtendedKalmanFilter and sensor.hx == OWN:
            raise InputError(f"sensors.{name}.hx: an ExtendedKalmanFilter has none of its own; name a function")
    held = [name for name, option in takes.own.items() if getattr(options, option) is None]
    functions = " and ".join(takes.own[name] for name in held or takes.own)
    counted = "a function" if len(held) == 1 else "functions"
    if held and options.dt_s is None:
        raise InputError(
            f"dt_s: missing: the filter's own {' and '.join(held)} {'holds' if len(held) == 1 else 'hold'} for one "
            f"interval only; say which (s), or give {functions}, as {counted} of dt"
        )
    if not held and options.dt_s is not None:
        raise InputError(f"dt_s: not used beside {functions}; remove it")
    return kind


def _only(given: set[str], used: tuple[str, ...], kind: type, where: str) -> None:
    for key in sorted(given - set(used)):
        raise InputError(f"{where}{key}: not used with {kind.__name__}, which takes {', '.join(used)}")


class SensorUse(NamedTuple):
    """How the measurements of a sensor are given to the filter, its functions found."""

    reader: Reader
    states_noise: bool = True
    own: bool = False
    """Whether the user's functions say what is expected, not trackbench's sensor models."""
    hx: Callable[..., Array] | None = None
    jacobian: Callable[..., Array] | None = None
    residual: Callable[..., Array] | None = None
    mean: Callable[..., Array] | None = None
    args: tuple[str, ...] = ()


def sensing(options: FilterPyOptions, kind: type, layout: Layout) -> dict[str, SensorUse] | SensorUse:
    """How each sensor's measurements are given to the filter, by the sensor's name or kind, or how those of all are.

    Raises:
        InputError: a function cannot be found.
    """
    # A linear filter can be given nothing but a position, unless the user says what its own H is of.
    usual = POSITION if kind is KalmanFilter else None

    def found(name: str, sensor: FilterPySensor) -> SensorUse:
        def of(key: str) -> Callable[..., Array] | None:
            reference = getattr(sensor, key)
            return None if reference in (None, OWN) else function(f"sensors.{name}.{key}", reference)

        return SensorUse(
            Reader(layout, sensor.measurement or usual),
            sensor.states_noise,
            sensor.hx is not None,
            of("hx"),
            of("HJacobian"),
            of("residual"),
            of("z_mean"),
            tuple(sensor.args),
        )

    if options.sensors is None:
        return SensorUse(Reader(layout, usual))
    return {name: found(name, sensor) for name, sensor in options.sensors.items()}
