"""Simulated truth, from the cache if it is there."""

from __future__ import annotations

import logging
import time

from trackbench.base.types import Progress
from trackbench.truth import cache as store
from trackbench.truth.base import LoadedTruth
from trackbench.truth.config import HighwayOptions

OWN_CLASSES = "highway_env."

log = logging.getLogger(__name__)


def load(config: HighwayOptions, cache: bool, progress: Progress) -> LoadedTruth:
    """Read the truth from the cache, or simulate and keep it."""
    notes = []
    try:
        kept = _read(config) if cache else None
    except ValueError as error:
        notes.append(f"cache: {error}; simulated again")
    else:
        if kept is not None:
            return kept

    from trackbench.truth import highway

    begin = time.perf_counter()
    truth = highway.simulate(config, progress)
    log.info("truth simulated in %.1f s: %s", time.perf_counter() - begin, config.env)
    if cache and _determined(config):
        file = store.path(config)
        try:
            store.write(file, config, truth)
            log.info("truth kept in the cache: %s", file)
        except OSError as error:
            notes.append(f"cache: {file.parent} cannot be written ({error.strerror}); the truth is not kept")
    return LoadedTruth(truth, cached=False, notes=tuple(notes))


def stored(config: HighwayOptions) -> LoadedTruth | None:
    """The truth from the cache; None where it is not there, or is damaged."""
    try:
        return _read(config)
    except ValueError:
        return None


def _read(config: HighwayOptions) -> LoadedTruth | None:
    if not _determined(config):
        return None
    file = store.path(config)
    truth = store.read(file, config)
    if truth is None:
        return None
    log.info("truth from the cache: %s", file)
    return LoadedTruth(truth, cached=True)


def _determined(config: HighwayOptions) -> bool:
    """Whether the configuration and the versions determine the truth: a user's own driver class may change."""
    vehicles = config.config.get("other_vehicles_type", OWN_CLASSES)
    return str(vehicles).startswith(OWN_CLASSES)
