"""Motion models as people write them, each with its parameters kept in another way."""

from __future__ import annotations

import math
import operator
from collections import namedtuple
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial, reduce, wraps
from itertools import accumulate, product
from math import cos, pi, radians, sqrt
from types import SimpleNamespace
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy import hypot
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr

from trackbench.base import linalg
from trackbench.base.config import Positive
from trackbench.base.types import Array
from trackbench.base.units import wrap_angle
from trackbench.models.motion import ConstantTurnRateVelocity, ConstantVelocity, MotionModel

# vehicle parameters
m = 1500.0  # kg
rho, Cd, A = 1.2, 0.3, 2.2
G: Final = 9.81
DEG = pi / 180
DRAG_TABLE = np.array([0.0, 0.001, 0.002, 0.004])
PARAMS = {"drag": 0.002, "rolling": 0.01, "max_speed": 60.0}
WEIGHTS = [0.5, 0.3, 0.2]


class Base(ConstantVelocity):
    """A vehicle that slows down by what ``deceleration`` says of its speed."""

    linear: ClassVar[bool] = False

    def deceleration(self, v: Array) -> Any:
        return 0.0

    def transition(self, x: Array, dt: float) -> Array:
        speed = np.sqrt(x[2] ** 2 + x[3] ** 2)
        left = 1.0 / (1.0 + dt * self.deceleration(speed) / (speed + 1e-3))
        return np.concatenate([x[:2] + dt * x[2:], left * x[2:]])


class ModuleConstants(Base):
    def deceleration(self, v: Array) -> Any:
        return 0.5 * rho * Cd * A / m * v**2


class Options(Base):
    drag_per_m: Positive = Field(0.003, description="Deceleration over speed squared, 1/m.")
    rolling: float = 0.01

    def deceleration(self, v: Array) -> Any:
        return self.drag_per_m * v * v + self.rolling * G


@dataclass
class VehicleParameters:
    mass: float = 1500.0
    drag: float = 0.4
    rolling: float = 0.012

    @property
    def drag_per_mass(self) -> float:
        return self.drag / self.mass


class InDataclass(Base):
    _vehicle: VehicleParameters = PrivateAttr(default_factory=VehicleParameters)

    def deceleration(self, v: Array) -> Any:
        p = self._vehicle
        return p.drag_per_mass * v**2 + p.rolling * G


@dataclass(frozen=True)
class AeroParams:
    rho: float = 1.2
    cd_a: float = 0.66


@dataclass(frozen=True)
class CarParams:
    m: float = 1200.0
    aero: AeroParams = field(default_factory=AeroParams)
    gears: tuple[float, ...] = (3.5, 2.1, 1.4)


CAR = CarParams()
TRUCK = replace(CAR, m=8000.0)


class NestedFrozen(Base):
    def deceleration(self, v: Array) -> Any:
        return 0.5 * TRUCK.aero.rho * TRUCK.aero.cd_a / TRUCK.m * v**2 + 0.001 * TRUCK.gears[0]


class Vehicle:
    """As most people write it."""

    def __init__(self, mass: float, cd: float = 0.3) -> None:
        self.mass = mass
        self.cd = cd
        self.k = 0.5 * rho * cd * A / mass

    def drag(self, v: Array) -> Any:
        return self.k * v**2

    def __repr__(self) -> str:
        return f"Vehicle({self.mass})"


car = Vehicle(1400.0)


class PlainObject(Base):
    def deceleration(self, v: Array) -> Any:
        return car.drag(v)


class ClassConstants(Base):
    DRAG: ClassVar[float] = 0.002
    COEFFICIENTS: ClassVar[tuple[float, float, float]] = (0.01, 0.002, 0.0005)

    def deceleration(self, v: Array) -> Any:
        a, b, c = self.COEFFICIENTS
        return a + b * v + c * v**2 + self.DRAG


class Polynomial(Base):
    """Horner's rule over a list of coefficients."""

    def deceleration(self, v: Array) -> Any:
        total: Any = 0.0
        for c in reversed(WEIGHTS):
            total = total * v + 0.001 * c
        return total


class DictOfParameters(Base):
    def deceleration(self, v: Array) -> Any:
        v = np.minimum(v, PARAMS["max_speed"])
        return PARAMS["drag"] * v**2 + PARAMS["rolling"]


def quadratic(v: Array, k: float = 0.002, *, offset: float = 0.01) -> Any:
    return k * v**2 + offset


class Helper(Base):
    def deceleration(self, v: Array) -> Any:
        return quadratic(v, offset=0.02)


class StaticHelpers(Base):
    @staticmethod
    def _square(v: Array) -> Array:
        return v * v

    @classmethod
    def _drag(cls, v: Array) -> Any:
        return 0.002 * cls._square(v)

    def deceleration(self, v: Array) -> Any:
        return self._drag(v)


class WithTable(Base):
    """A piecewise constant table, by masks."""

    def deceleration(self, v: Array) -> Any:
        edges = np.array([0.0, 5.0, 10.0, 20.0])
        return sum(np.where(v >= edge, step, 0.0) for edge, step in zip(edges, DRAG_TABLE, strict=True))


class ComputedAtConstruction(Base):
    half_time_s: Positive = 8.0
    _rate: float = PrivateAttr(0.0)
    _matrix: Any = PrivateAttr(None)

    def model_post_init(self, context: Any) -> None:
        self._rate = math.log(2.0) / self.half_time_s
        self._matrix = np.diag([self._rate, self._rate])

    def deceleration(self, v: Array) -> Any:
        return self._matrix[0, 0] * v


class ComputedOnce(Base):
    half_time_s: Positive = 8.0

    @cached_property
    def rate(self) -> float:
        return math.log(2.0) / self.half_time_s

    def deceleration(self, v: Array) -> Any:
        return self.rate * v


class Turning(ConstantTurnRateVelocity):
    """CTRV whose turn fades."""

    def transition(self, x: Array, dt: float) -> Array:
        y = super().transition(x, dt)
        return linalg.vector([y[0], y[1], y[2], wrap_angle(y[3]), y[4] * 0.99])


class WrittenOut(MotionModel):
    """All of a Singer-like model, from scratch."""

    tau_s: Positive = 4.0
    jerk_sigma_mps3: Positive = 1.0
    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy")
    driving_noise: ClassVar[tuple[str, ...]] = ("jerk_sigma_mps3", "jerk_sigma_mps3")

    def transition(self, x: Array, dt: float) -> Array:
        a = np.exp(-dt / self.tau_s)
        px, py, vx, vy = x
        return linalg.vector([px + self.tau_s * (1 - a) * vx, py + self.tau_s * (1 - a) * vy, a * vx, a * vy])

    def jacobian(self, x: Array, dt: float) -> Array:
        a = np.exp(-dt / self.tau_s)
        b = self.tau_s * (1 - a)
        return linalg.matrix([[1, 0, b, 0], [0, 1, 0, b], [0, 0, a, 0], [0, 0, 0, a]])

    def noise_gain(self, x: Array, dt: float) -> Array:
        return linalg.matrix([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])


class Surface(NamedTuple):
    friction: float
    slope: float = 0.0

    def resistance(self, g: float = G) -> float:
        return g * (self.friction * cos(self.slope) + math.sin(self.slope))


ASPHALT = Surface(0.012, radians(1.5))
Limits = namedtuple("Limits", ["v_max", "a_max"])
limits = Limits(v_max=70.0, a_max=3.0)


class Tuples(Base):
    def deceleration(self, v: Array) -> Any:
        return np.clip(ASPHALT.resistance() * v / limits.v_max, -limits.a_max, limits.a_max)


config = SimpleNamespace(cd=0.3, area=2.1, mass=1300.0, scale=SimpleNamespace(air=1.2))


class Namespaces(Base):
    def deceleration(self, v: Array) -> Any:
        return 0.5 * config.scale.air * config.cd * config.area / config.mass * v**2


def make_drag(k: float, power: int = 2) -> Callable[[Array], Any]:
    def drag(v: Array) -> Any:
        return k * v**power

    return drag


class ClosuresAndPartials(Base):
    drag: ClassVar[Any] = staticmethod(make_drag(0.002))
    rolling: ClassVar[Any] = partial(quadratic, k=0.0, offset=0.05)

    def deceleration(self, v: Array) -> Any:
        return self.drag(v) + self.rolling(v)


def non_negative(function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def wrapper(*args: Any, **kwargs: Any) -> Any:
        return np.maximum(function(*args, **kwargs), 0.0)

    return wrapper


class Decorated(Base):
    @non_negative
    def deceleration(self, v: Array) -> Any:
        return 0.01 * v - 0.02


class RungeKutta(Base):
    """Fourth order, in a fixed number of steps."""

    steps: int = 2

    def _rate(self, s: Sequence[Any]) -> list[Any]:
        _, _, vx, vy = s
        v = np.hypot(vx, vy)
        return [vx, vy, -0.003 * v * vx, -0.003 * v * vy]

    def transition(self, x: Array, dt: float) -> Array:
        h = dt / self.steps
        state = [x[0], x[1], x[2], x[3]]
        for _ in range(self.steps):
            k1 = self._rate(state)
            k2 = self._rate([s + h / 2 * k for s, k in zip(state, k1, strict=True)])
            k3 = self._rate([s + h / 2 * k for s, k in zip(state, k2, strict=True)])
            k4 = self._rate([s + h * k for s, k in zip(state, k3, strict=True)])
            parts = zip(state, k1, k2, k3, k4, strict=True)
            state = [s + h / 6 * (a + 2 * b + 2 * c + d) for s, a, b, c, d in parts]
        return linalg.vector(state)


class Tyre(BaseModel):
    model_config = ConfigDict(frozen=True)
    radius: float = 0.31
    pressure: dict[str, float] = {"front": 2.2, "rear": 2.0}


class WithModel(Base):
    tyre: Tyre = Tyre()

    def deceleration(self, v: Array) -> Any:
        return 0.01 * self.tyre.radius * sum(self.tyre.pressure.values())


class ByName(Base):
    """Switches by a string, and complains of others."""

    kind: str = "quadratic"
    laws: ClassVar[dict[str, Callable[[Any], Any]]] = {
        "linear": lambda v: 0.02 * v,
        "quadratic": lambda v: 0.002 * v**2,
    }

    def deceleration(self, v: Array) -> Any:
        if self.kind not in self.laws:
            raise ValueError(f"no law {self.kind!r}; one of {', '.join(self.laws)}")
        return self.laws[self.kind](v)


class Damping:
    damping: ClassVar[float] = 0.02

    def damped(self, v: Array) -> Any:
        return self.damping * v


class Mixed(Damping, Base):
    def deceleration(self, v: Array) -> Any:
        return self.damped(v) + super().deceleration(v)


class Reduced(Base):
    def deceleration(self, v: Array) -> Any:
        powers = accumulate([v, v, v], operator.mul)
        return reduce(operator.add, [0.001 * w * p for w, p in zip(WEIGHTS, powers, strict=True)])


class Blended(Base):
    """A smooth change between two regimes, with guards against division by zero."""

    low: Positive = 5.0
    high: Positive = 15.0

    def deceleration(self, v: NDArray[np.float64]) -> Any:
        assert self.low < self.high
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.clip((v - self.low) / (self.high - self.low), 0.0, 1.0)
            smooth = share * share * (3 - 2 * share)
            return np.where(v > 0, (1 - smooth) * 0.01 + smooth * 0.002 * v**2 / v, 0.0)


class FixedMatrix(Base):
    """A linear step by a matrix that is made of numbers, at a fixed rate."""

    F: ClassVar[Any] = np.eye(4) + 0.1 * np.diag([1.0, 1.0], k=2)

    def transition(self, x: Array, dt: float) -> Array:
        return linalg.matmul(self.F, x)


class Stiffness:
    def __init__(self, front: float = 8e4, rear: float = 9e4) -> None:
        self.front, self.rear = front, rear
        self.history: list[float] = []

    @property
    def mean(self) -> float:
        return sqrt(self.front * self.rear)

    def __call__(self, v: Array) -> Any:
        return 1e-7 * self.mean * v


class CallableObject(Base):
    _stiffness: Any = PrivateAttr(default_factory=Stiffness)

    def deceleration(self, v: Array) -> Any:
        return self._stiffness(v)


@cache
def binomials(n: int) -> tuple[int, ...]:
    return tuple(math.comb(n, k) for k in range(n + 1))


class Cached(Base):
    def deceleration(self, v: Array) -> Any:
        return sum(1e-4 * b * v**k for k, b in enumerate(binomials(3)))


class Bicycle(ConstantTurnRateVelocity):
    """Kinematic, with the slip angle of a given steering."""

    lf: Positive = 1.2
    lr: Positive = 1.6
    steering_deg: float = 2.0

    def _slip(self) -> float:
        return math.atan(self.lr / (self.lf + self.lr) * math.tan(self.steering_deg * DEG))

    def transition(self, x: Array, dt: float) -> Array:
        px, py, v, yaw, rate = x
        beta = self._slip()
        turned = yaw + v / self.lr * math.sin(beta) * dt
        return linalg.vector([px + v * np.cos(yaw + beta) * dt, py + v * np.sin(yaw + beta) * dt, v, turned, rate])


class RoadGrid(Base):
    """Drag by a grid of centres, written with comprehensions."""

    centres: ClassVar[list[tuple[float, float]]] = list(product((0.0, 20.0), (0.0, 20.0)))

    def transition(self, x: Array, dt: float) -> Array:
        near = [np.exp(-(hypot(x[0] - a, x[1] - b) ** 2) / 200.0) for a, b in self.centres]
        left = 1 - 0.05 * dt * sum(near)
        return np.concatenate([x[:2] + dt * x[2:], left * x[2:]])


#: Known while the rule was written.
KNOWN: list[type[MotionModel]] = [
    ModuleConstants,
    Options,
    InDataclass,
    NestedFrozen,
    PlainObject,
    ClassConstants,
    Polynomial,
    DictOfParameters,
    Helper,
    StaticHelpers,
    WithTable,
    ComputedAtConstruction,
    ComputedOnce,
    Turning,
    WrittenOut,
]
#: Set aside until it was.
SET_ASIDE: list[type[MotionModel]] = [
    Tuples,
    Namespaces,
    ClosuresAndPartials,
    Decorated,
    RungeKutta,
    WithModel,
    ByName,
    Mixed,
    Reduced,
    Blended,
    FixedMatrix,
    CallableObject,
    Cached,
    RoadGrid,
    Bicycle,
]
