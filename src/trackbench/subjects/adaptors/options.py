"""The options of the adaptors, in common and of each library; no library is needed to read them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from importlib.util import find_spec
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import BeforeValidator, Field, WithJsonSchema

from trackbench.base import plugins
from trackbench.base.config import Config, Positive, Problem, problem_error
from trackbench.base.errors import InputError, TrackbenchError, nearest_choices
from trackbench.base.types import Scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.adaptors import layout
from trackbench.subjects.adaptors.layout import ELEVATION, POSITION, readable_components
from trackbench.trackers.config import STATE_COMPONENTS
from trackbench.trackers.initial import InitialConfig

Entry = TypeVar("Entry")

OWN = "own"
#: How a track may start from measurements.
STARTS = ("first_measurement", "two_measurements")


#: The JSON Schema of ``initial``: a word, or the mapping that it is short for.
STARTED = {"anyOf": [{"enum": [OWN, *STARTS]}, {"type": "object"}]}


class SensorOptions(Config):
    """How the measurements of a sensor are given to a filter."""

    measurement: str | list[str] | None = Field(
        None,
        description="position (a KalmanFilter's default), or the components that are given; all unless given.",
    )
    R: Literal["stated", "own"] | None = Field(
        None, description="The noise covariance: as the sensor states it (the default), or the filter's own."
    )

    def problems(self) -> Iterator[Problem]:
        if isinstance(self.measurement, str) and self.measurement != POSITION:
            yield Problem(("measurement",), f"write {POSITION}, or a list of components such as [range, azimuth]")
        if not isinstance(self.measurement, list):
            return
        readable = (*readable_components(), ELEVATION)
        for index, name in enumerate(self.measurement):
            if name not in readable:
                yield Problem(("measurement", index), f"no sensor reads {name!r}: {nearest_choices(name, readable)}")
        if not self.measurement:
            yield Problem(("measurement",), f"empty; name components, or {POSITION}")
        if ELEVATION in self.measurement and self.R != OWN:
            yield Problem(("R",), "no sensor states how uncertain the elevation is: use R: own")

    @property
    def states_noise(self) -> bool:
        """Whether the filter is given the covariance that the sensor states."""
        return self.R != OWN


def _start(value: Any) -> Any:
    """``own`` as None, and another word as the mapping that it is short for."""
    if value == OWN:
        return None
    if value is None or (isinstance(value, str) and value not in STARTS):
        raise problem_error(nearest_choices(str(value), [OWN, *STARTS]))
    return {"from": "two_measurements", **value} if isinstance(value, dict) else value


class AdaptorOptions(Config):
    """Options that do not depend on the library."""

    package: ClassVar[str]
    """The library's package, an extra of trackbench."""
    library: ClassVar[str]
    """Its name."""

    state: list[str] = Field(
        description="the state's components in the filter's order, such as [px, vx, py, vy]; other: any further one"
    )
    initial: Annotated[InitialConfig | None, BeforeValidator(_start), WithJsonSchema(STARTED)] = Field(
        description="own (x and P as set, before the first measurement), first_measurement or two_measurements"
    )
    """None: as the filter itself is set."""
    dt_s: Positive | None = Field(None, description="Interval of the filter's own matrices, s; multiples are split.")

    def problems(self) -> Iterator[Problem]:
        if find_spec(self.package) is None:
            yield Problem((), f'{self.library} is not installed: pip install "trackbench[{self.package}]"')
        wrong = layout.problem(self.state)
        if wrong is not None:
            yield Problem(("state",), wrong)
        if self.initial is None:
            return
        if self.initial.source not in STARTS:
            yield Problem(("initial", "from"), f"choose from: {', '.join(STARTS)}; or write initial: {OWN}")
        for key, names in STATE_COMPONENTS.items():
            if key in self.initial.model_fields_set and not set(names) & set(self.state):
                yield Problem(("initial", key), f"the state has no {' or '.join(names)}")
        diagonal = self.initial.covariance_diag
        if diagonal is not None and len(diagonal) != len(self.state):
            sizes = f"the state has {len(self.state)} components, not {len(diagonal)}"
            yield Problem(("initial", "covariance_diag"), sizes)


def sensor_problems(sensors: Mapping[str, SensorOptions]) -> Iterator[Problem]:
    """What cannot be taken of a sensor whose kind is known from its key."""
    for name, sensor in sensors.items():
        if name in SENSOR_MODELS.names() and isinstance(sensor.measurement, list):
            read = (*SENSOR_MODELS[name].components, ELEVATION)
            for index, component in enumerate(sensor.measurement):
                if component not in read and component in readable_components():
                    hint = nearest_choices(component, read)
                    yield Problem(("sensors", name, "measurement", index), f"a {name} reads no {component}: {hint}")


def entry_of_sensor(sensors: Mapping[str, Entry], scan: Scan) -> Entry:
    """The entry of a scan's sensor, which is by its name or by its kind.

    Raises:
        TrackbenchError: there is none.
    """
    for key in (scan.sensor, scan.kind):
        if key in sensors:
            return sensors[key]
    hint = nearest_choices(scan.sensor, sensors)
    raise TrackbenchError(f"options.sensors has no entry for {scan.sensor} ({scan.kind}), by its name or kind: {hint}")


def import_named(option: str, reference: str) -> Any:
    """What an option names.

    Raises:
        InputError: it cannot be imported.
    """
    try:
        return plugins.load_reference(reference)
    except InputError as error:
        raise InputError(f"{option}: {error.message}") from error


def import_function(option: str, reference: str) -> Callable[..., Any]:
    """The function that an option names.

    Raises:
        InputError: it cannot be imported, or is not a function.
    """
    call = import_named(option, reference)
    if not callable(call):
        raise InputError(f"{option}: {reference!r} is not a function")
    return call  # type: ignore[no-any-return]


def made(option: str, reference: str, arguments: Mapping[str, Any], kind: Callable[[Any], bool]) -> Any:
    """The object that an option names, or that the function makes which it names.

    Args:
        option: the option's key, for messages.
        reference: ``"module:attribute"``.
        arguments: given to the function; an object takes none.
        kind: whether something is the object, and not a function that makes it.

    Raises:
        InputError: it cannot be imported or made.
    """
    value = import_named(option, reference)
    if kind(value):
        if arguments:
            raise InputError(f"{option}_options: {reference!r} is an object, not a function that would take them")
        return value
    if not callable(value):
        return value
    try:
        return value(**arguments)
    except (Exception, SystemExit) as error:
        raise InputError(f"{option}: {reference!r} raises {type(error).__name__}: {error}") from error


def takes_state(option: str, reference: str, call: Callable[..., Any]) -> bool:
    """Whether a function takes the state and dt, or dt alone.

    Raises:
        InputError: neither.
    """
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    parameters = inspect.signature(call).parameters.values()
    needed = [item for item in parameters if item.kind in positional and item.default is item.empty]
    if len(needed) not in (1, 2):
        raise InputError(f"{option}: {reference!r} has to take (dt) or (x, dt), not {len(needed)} arguments")
    return len(needed) == 2


class FilterPySensor(SensorOptions):
    """How the measurements of a sensor are given to the filter; functions are called as FilterPy calls them."""

    hx: str | None = Field(None, description="own, or the function that gives the expected measurement.")
    HJacobian: str | None = Field(None, description="EKF only. The derivative of hx, as module:name.")
    residual: str | None = Field(None, description="Subtracts two measurements, with wrapped azimuth, as module:name.")
    z_mean: str | None = Field(None, description="UKF only. The function that averages measurements, as module:name.")
    args: list[str] = Field(default_factory=list, description="Fields of the scan that hx takes after the state.")

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        for index, name in enumerate(self.args):
            if name not in Scan._fields:
                yield Problem(("args", index), f"a scan has no {name!r}: {nearest_choices(name, Scan._fields)}")
        for key in ("HJacobian", "residual", "z_mean", "args"):
            if key in self.model_fields_set and self.hx is None:
                yield Problem((key,), "not used without hx")


class FilterPyOptions(AdaptorOptions):
    """The keys under ``options`` where a scenario says ``use: filterpy``."""

    package = "filterpy"
    library = "FilterPy"

    filter: str = Field(description='the filter, or a function that makes one, as "module:name"')
    filter_options: dict[str, Any] = Field(default_factory=dict, description="Arguments of a function that makes it.")
    transition: str | None = Field(
        None, description="F, a function of dt or of x and dt, as module:name; not of a UKF."
    )
    fx: str | None = Field(None, description="EKF only. State after dt, of x and dt; transition is then its Jacobian.")
    process_noise: str | None = Field(None, description="Function that gives Q, of dt or of x and dt, as module:name.")
    sensors: dict[str, FilterPySensor] | None = Field(
        None, min_length=1, description="By name or kind, how a sensor's measurements are given to the filter."
    )

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        yield from sensor_problems(self.sensors or {})
        if self.fx is not None and self.transition is None:
            yield Problem(("transition",), "missing: beside fx it gives the Jacobian of fx")


class StoneSoupSensor(SensorOptions):
    """How the measurements of a sensor are given to the updater."""

    measurement_model: str | None = Field(None, description="own, a model, or a function that makes it of the scan.")
    pose: Literal["stated", "own"] | None = Field(
        None, description="Pose of the model: the sensor's (default), or its own."
    )

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        for key in ("R", "pose"):
            if getattr(self, key) is not None and self.measurement_model is None:
                yield Problem((key,), "not used without measurement_model")


class StoneSoupOptions(AdaptorOptions):
    """The keys under ``options`` where a scenario says ``use: stonesoup``."""

    package = "stonesoup"
    library = "Stone Soup"

    pair: str = Field(description='predictor and updater, or a function that makes them, as "module:name"')
    pair_options: dict[str, Any] = Field(default_factory=dict, description="Arguments of a function that makes them.")
    sensors: dict[str, StoneSoupSensor] | None = Field(
        None, min_length=1, description="By name or kind, how a sensor's measurements are given to the updater."
    )

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        yield from sensor_problems(self.sensors or {})
