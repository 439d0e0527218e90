"""A tracker in a shared library, by the C interface of trackbench.h; its arrays are those of NumPy, in place."""

from __future__ import annotations

import ctypes
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Estimate, Scan, Tracks
from trackbench.trackers.answers import KEPT_THERE, Tracker, TrackerFault
from trackbench.trackers.config import PluginConfig
from trackbench.trackers.foreign import Library
from trackbench.trackers.published import check_tracker_options, create

ABI = 1
NONE, ESTIMATE, TRACKS, FAILED = 0, 1, 2, -1
#: Tracks of one member; more are an error of the library.
MOST_TRACKS = 100_000
_Pointer, _Double, _Int, _Text = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64, ctypes.c_char_p


class _Scan(ctypes.Structure):
    _fields_ = (
        *((name, _Double) for name in ("time", "arrival_time")),
        *((name, _Text) for name in ("sensor", "kind")),
        *((name, _Int) for name in ("components", "detections", "batch")),
        *((name, _Pointer) for name in ("measurement", "valid", "noise_covariance", "sensor_pose", "sensor_velocity")),
        *((name, _Double) for name in ("detection_probability", "clutter_density")),
        ("field_of_view", _Pointer),
        *((name, _Int) for name in ("asked", "place")),
    )


class _Answer(ctypes.Structure):
    _fields_ = (
        *((name, _Pointer) for name in ("mean", "covariance")),
        ("tracks", _Int),
        *((name, _Pointer) for name in ("ids", "existence", "used")),
        ("error", _Text),
    )


class _Traits(ctypes.Structure):
    _fields_ = (("abi", _Int), ("name", _Text), ("batched", _Int), ("random", _Int), ("copies", _Int))


#: By name, what they return and are given.
_FUNCTIONS: dict[str, tuple[Any, ...]] = {
    "tb_describe": (None, ctypes.POINTER(_Traits)),
    "tb_create": (_Pointer, _Text, _Int),
    "tb_step": (_Int, _Pointer, ctypes.POINTER(_Scan), ctypes.POINTER(_Answer)),
    "tb_copy": (_Pointer, _Pointer),
    "tb_destroy": (None, _Pointer),
}


def maker(config: PluginConfig, folder: Path | None, several: bool = False) -> Callable[[], Tracker]:
    """A function that makes fresh trackers of a scenario's entry in this process; one is made to see that it can be.

    Raises:
        InputError: there is no such class or library, or it does not start with the options.
    """
    if not isinstance(config.use, Library):
        return create(config.reference, config.options, folder)
    library = load_library(config.use, folder)
    make = partial(LibraryTracker, library, config.use.library, json.dumps(config.options), several)
    make()
    return make


def check_entry(config: PluginConfig, folder: Path | None) -> None:
    """Find the class or library of a scenario's entry; it is not started.

    Raises:
        InputError: there is none, or the options are not those that it declares.
    """
    if isinstance(config.use, Library):
        load_library(config.use, folder)
    else:
        check_tracker_options(config.reference, config.options, folder)


def load_library(use: Library, folder: Path | None) -> ctypes.CDLL:
    """The library, with the types of its functions.

    Raises:
        InputError: it is not there, cannot be loaded, or lacks a function.
    """
    path = use.resolved(folder)
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise InputError(f"{use.library!r} cannot be loaded: {error}") from None
    missing = [name for name in _FUNCTIONS if not hasattr(library, name)]
    if missing:
        raise InputError(f"{use.library!r} has no {' and no '.join(missing)}, which trackbench.h declares")
    for name, (result, *arguments) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


class LibraryTracker:
    """One tracker of a library.

    Args:
        library: loaded.
        name: of it, in messages.
        options: as JSON.
        several: whether it is to follow several objects.
        own: a tracker that the library has copied; a fresh one is created unless given.

    Raises:
        InputError: the library creates none, or has another interface.
    """

    def __init__(
        self, library: ctypes.CDLL, name: str, options: str, several: bool = False, own: int | None = None
    ) -> None:
        self._library, self._name, self._options, self._several = library, name, options, several
        traits = _Traits()
        library.tb_describe(ctypes.byref(traits))
        if traits.abi != ABI:
            raise InputError(f"{name!r} has version {traits.abi} of the interface, and this trackbench {ABI}")
        self.batched, self.random, self._copies = (
            bool(trait) for trait in (traits.batched, traits.random, traits.copies)
        )
        self._own = library.tb_create(options.encode(), several) if own is None else own
        if not self._own:
            raise InputError(f"{name!r} does not start with these options: tb_create returned NULL")
        self._scan, self._answer = _Scan(), _Answer()

    def step(self, state: str | None, scan: Scan) -> tuple[str, Any]:
        """What stands for its state, and the answer.

        Raises:
            TrackerFault: it says that it failed, or its answer makes no sense.
        """
        arrays = self._fill(scan)
        batch = np.shape(scan.valid)[1 if self._several else 0 :]
        mean, covariance = np.full((4, *batch), np.nan), np.full((4, 4, *batch), np.nan)
        answer = self._answer
        ctypes.memset(ctypes.byref(answer), 0, ctypes.sizeof(answer))
        answer.mean, answer.covariance = _address(mean), _address(covariance)
        kind = self._library.tb_step(self._own, ctypes.byref(self._scan), ctypes.byref(answer))
        del arrays
        if kind == NONE:
            return KEPT_THERE, None
        if kind == ESTIMATE and not self._several:
            return KEPT_THERE, Estimate(mean, covariance)
        if kind == TRACKS and self._several:
            return KEPT_THERE, self._tracks(answer, batch)
        if kind == FAILED:
            raise TrackerFault(f"{self._name}: {(answer.error or b'it failed').decode(errors='replace')}")
        wanted = "TB_TRACKS" if self._several else "TB_ESTIMATE"
        raise TrackerFault(f"tb_step returned {kind}, where {wanted}, TB_NONE or TB_FAILED is due")

    def _fill(self, scan: Scan) -> list[Array]:
        """Fill in the scan; return its arrays, which are to live as long as it is read."""
        values = (scan.measurement, scan.valid, scan.noise_covariance, scan.sensor_pose, scan.sensor_velocity)
        arrays = [np.ascontiguousarray(value, dtype=float) for value in values]
        target, shape = self._scan, arrays[0].shape
        target.measurement, target.valid, target.noise_covariance, target.sensor_pose, target.sensor_velocity = map(
            _address, arrays
        )
        target.time, target.arrival_time = scan.time, scan.arrival_time
        target.sensor, target.kind = scan.sensor.encode(), scan.kind.encode()
        target.components, target.detections = shape[0], shape[1] if self._several else 1
        target.batch = shape[-1] if self.batched else 1
        target.detection_probability, target.clutter_density = (
            np.nan if value is None else value for value in (scan.detection_probability, scan.clutter_density)
        )
        target.field_of_view = None
        if scan.field_of_view is not None:
            arrays.append(np.array([np.nan if value is None else value for value in scan.field_of_view]))
            target.field_of_view = _address(arrays[-1])
        target.asked, target.place = scan.asked, scan.place
        return arrays

    def _tracks(self, answer: _Answer, batch: tuple[int, ...]) -> Tracks:
        count = int(answer.tracks)
        if not 0 <= count <= MOST_TRACKS:
            raise TrackerFault(f"it gave {count} tracks")
        parts: dict[str, Any] = {}
        for name, shape in (("ids", ()), ("mean", (4,)), ("covariance", (4, 4)), ("existence", ()), ("used", ())):
            place = getattr(answer, name)
            if place is None and name in ("existence", "used"):
                continue
            size = int(np.prod((*shape, count, *batch)))
            if place is None and size:
                raise TrackerFault(f"it gave {count} tracks and NULL as {name}")
            numbers = np.zeros(size)
            if size:
                ctypes.memmove(_address(numbers), place, numbers.nbytes)
            parts[name] = numbers.reshape(*shape, count, *batch)
        return Tracks(**parts)

    def __deepcopy__(self, memo: object) -> LibraryTracker:
        copied = self._library.tb_copy(self._own) if self._copies else None
        if not copied:
            raise TypeError("its library does not copy trackers")
        return LibraryTracker(self._library, self._name, self._options, self._several, copied)

    def __del__(self) -> None:
        if getattr(self, "_own", None):
            self._library.tb_destroy(self._own)


def _address(array: Array) -> int:
    address: int = array.__array_interface__["data"][0]
    return address
