"""Simulated truth, from the cache if it is there."""

from __future__ import annotations

import hashlib
import io
import json
import logging
import time
import zipfile
from collections.abc import Iterable
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base import streams, types, units
from trackbench.base.files import cache_folder, write_whole
from trackbench.base.types import Observer, Progress, Truth
from trackbench.truth.base import LoadedTruth
from trackbench.truth.config import HighwayOptions

PACKAGES = ("trackbench", "highway-env", "gymnasium", "numpy")
OWN_CLASSES = "highway_env."

log = logging.getLogger(__name__)


def cache_file(config: HighwayOptions) -> Path:
    """The file of the truth that ``config`` and the installed versions determine."""
    return cache_folder() / f"{config.env.replace('/', '_')}-{_key(config)[:32]}.truth"


def stored(config: HighwayOptions) -> LoadedTruth | None:
    """Return the truth from the cache; None where it is not there, is damaged, or may have changed."""
    file = cache_file(config)
    if not _determined(config) or not file.exists():
        return None
    try:
        with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        truth = _unpacked(arrays, json.loads(str(arrays.pop("meta"))))
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        log.warning("cache: %s cannot be read (%s); simulated again", file, error)
        return None
    log.info("truth from the cache: %s", file)
    return LoadedTruth(truth, cached=True)


def _key(config: HighwayOptions) -> str:
    meaning = {
        "config": config.model_dump(mode="json", exclude={"drivers"} if config.drivers == "steady" else set()),
        "versions": {package: version(package) for package in PACKAGES},
        "source": fingerprint(motion_files()),
    }
    return hashlib.sha256(json.dumps(meaning, sort_keys=True).encode()).hexdigest()


def motion_files() -> list[Path]:
    """List the source files that determine the motion and how it is stored: a change of one makes other truths."""
    below = (Path(str(module.__file__)) for module in (streams, types, units))
    return [*sorted(Path(__file__).parent.glob("*.py")), *below]


def fingerprint(files: Iterable[Path]) -> str:
    """Return a hash of the names and contents of files."""
    return hashlib.sha256(b"".join(file.name.encode() + file.read_bytes() for file in files)).hexdigest()


def _packed(truth: Truth) -> bytes:
    arrays: dict[str, Any] = {
        **{name: value for name, value in _attributes(truth).items() if isinstance(value, np.ndarray)},
        **{f"observer.{name}": value for name, value in _attributes(truth.observer).items()},
        **{f"roads.{i}": line for i, line in enumerate(truth.roads)},
    }
    meta = {"ids": truth.ids, "source": truth.source, "audit": truth.audit, "roads": len(truth.roads)}
    stream = io.BytesIO()
    np.savez(stream, meta=np.array(json.dumps(meta)), **arrays)
    return stream.getvalue()


def _unpacked(arrays: dict[str, Any], meta: dict[str, Any]) -> Truth:
    observer: dict[str, Any] = {field.name: arrays.pop(f"observer.{field.name}") for field in fields(Observer)}
    roads = tuple(arrays.pop(f"roads.{i}") for i in range(meta["roads"]))
    observer.update({name: float(observer[name]) for name in ("length", "width")})
    return Truth(
        **arrays,
        ids=tuple(meta["ids"]),
        observer=Observer(**observer),
        roads=roads,
        source=meta["source"],
        audit=meta["audit"],
    )


def _attributes(value: Any) -> dict[str, Any]:
    return {field.name: getattr(value, field.name) for field in fields(value)}


def load_simulated(config: HighwayOptions, cache: bool, progress: Progress) -> LoadedTruth:
    """Read the truth from the cache, or simulate and keep it."""
    if cache and (kept := stored(config)) is not None:
        return kept

    from trackbench.truth import highway

    begin = time.perf_counter()
    truth = highway.simulate(config, progress)
    log.info("truth simulated in %.1f s: %s", time.perf_counter() - begin, config.env)
    if cache and _determined(config):
        try:
            write_whole(cache_file(config), _packed(truth))
        except OSError as error:
            log.warning("cache: %s cannot be written (%s); the truth is not kept", cache_file(config), error.strerror)
    return LoadedTruth(truth)


def _determined(config: HighwayOptions) -> bool:
    """Whether the configuration and the versions determine the truth: a user's own driver class may change."""
    vehicles = config.config.get("other_vehicles_type", OWN_CLASSES)
    return str(vehicles).startswith(OWN_CLASSES)
