"""Simulated ground truth, read from the cache if possible."""

from __future__ import annotations

import gzip
import hashlib
import json
import logging
import pickle
import time
import zlib
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

from trackbench.base import streams, types, units
from trackbench.base.files import cache_folder, write_whole
from trackbench.base.types import Progress, Truth
from trackbench.truth.base import LoadedTruth
from trackbench.truth.config.highway import HighwayOptions

PACKAGES = ("trackbench", "highway-env", "gymnasium", "numpy")
OWN_CLASSES = "highway_env."

log = logging.getLogger(__name__)


def cache_file(config: HighwayOptions) -> Path:
    """Return the path of the cache file, named by a hash of the options and the installed versions."""
    return cache_folder() / f"{config.env.replace('/', '_')}-{_key(config)[:32]}.truth"


def stored(config: HighwayOptions) -> LoadedTruth | None:
    """Return the truth from the cache; None if it is missing, damaged, or possibly outdated."""
    file = cache_file(config)
    if not _determined(config) or not file.exists():
        return None
    try:
        # The checksum of gzip tells a damaged file.
        truth: Truth = pickle.loads(gzip.decompress(file.read_bytes()))
    except (OSError, EOFError, zlib.error) as error:
        log.warning("cache: %s cannot be read (%s); simulated again", file, error)
        return None
    log.info("truth from the cache: %s", file)
    return LoadedTruth(truth, cached=True)


def _key(config: HighwayOptions) -> str:
    meaning = {
        "config": config.model_dump(mode="json", exclude={"drivers"} if config.drivers == "steady" else set()),
        "others_within_m": config.others_within_m,
        "versions": {package: version(package) for package in PACKAGES},
        "source": fingerprint(motion_files()),
    }
    return hashlib.sha256(json.dumps(meaning, sort_keys=True).encode()).hexdigest()


def motion_files() -> list[Path]:
    """List the source files that determine the motion and its stored form; their hash is part of the cache's key."""
    below = (Path(str(module.__file__)) for module in (streams, types, units))
    return [*sorted(Path(__file__).parent.glob("*.py")), *below]


def fingerprint(files: Iterable[Path]) -> str:
    """Return a hash of the names and contents of files."""
    return hashlib.sha256(b"".join(file.name.encode() + file.read_bytes() for file in files)).hexdigest()


def load_simulated(config: HighwayOptions, cache: bool, progress: Progress) -> LoadedTruth:
    """Read the truth from the cache, or simulate and cache it."""
    if cache and (cached := stored(config)) is not None:
        return cached

    from trackbench.truth import highway

    begin = time.perf_counter()
    truth = highway.simulate(config, progress)
    log.info("truth simulated in %.1f s: %s", time.perf_counter() - begin, config.env)
    if cache and _determined(config):
        try:
            write_whole(cache_file(config), gzip.compress(pickle.dumps(truth), compresslevel=0))
        except OSError as error:
            log.warning("cache: %s cannot be written (%s); the truth is not kept", cache_file(config), error.strerror)
    return LoadedTruth(truth)


def _determined(config: HighwayOptions) -> bool:
    """Return whether the truth can be cached: not with a user's own driver class, which could change unnoticed."""
    vehicles = config.config.get("other_vehicles_type", OWN_CLASSES)
    return str(vehicles).startswith(OWN_CLASSES)
