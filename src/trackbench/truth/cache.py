"""Truth on disk, so that a second run does not simulate again.

An entry is one file: a line with the format's name and the checksum of what follows, then a NumPy archive without
pickled objects. Whatever is not exactly that counts as damaged and is simulated again.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.files import cache_folder, write_whole
from trackbench.base.types import Observer, Truth
from trackbench.truth.config import HighwayOptions

#: To be raised whenever the same configuration leads to another truth, or is stored in another way.
FORMAT = 4
HEADER = f"trackbench truth {FORMAT}"
PACKAGES = ("trackbench", "highway-env", "gymnasium", "numpy")


def path(config: HighwayOptions) -> Path:
    """The file of the truth that ``config`` and the installed versions determine."""
    return cache_folder() / f"{config.env.replace('/', '_')}-{_key(config)[:32]}.truth"


def read(file: Path, config: HighwayOptions) -> Truth | None:
    """The stored truth; None where there is none.

    Raises:
        ValueError: the entry is damaged, or is not what it should be.
    """
    try:
        content = file.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ValueError(f"{file} cannot be read ({error.strerror})") from error
    header, _, payload = content.partition(b"\n")
    if header != _header(payload):
        raise ValueError(f"{file} is damaged or not a truth of this version")
    try:
        with np.load(io.BytesIO(payload), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        meta = json.loads(str(arrays.pop("meta")))
        truth = _unpacked(arrays, meta)
    except (KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"{file} is damaged ({error})") from error
    if meta["key"] != _key(config):
        raise ValueError(f"{file} is the truth of something else")
    return truth


def write(file: Path, config: HighwayOptions, truth: Truth) -> None:
    """Store ``truth``, under its final name only when it is whole.

    Raises:
        OSError: the folder cannot be written.
    """
    payload = _packed(truth, _key(config))
    write_whole(file, _header(payload) + b"\n" + payload)


def _key(config: HighwayOptions) -> str:
    meaning = {
        "config": config.model_dump(mode="json"),
        "versions": {package: version(package) for package in PACKAGES},
        "format": FORMAT,
    }
    return hashlib.sha256(json.dumps(meaning, sort_keys=True).encode()).hexdigest()


def _header(payload: bytes) -> bytes:
    return f"{HEADER} {hashlib.sha256(payload).hexdigest()}".encode()


def _packed(truth: Truth, key: str) -> bytes:
    arrays: dict[str, Any] = {
        **{name: value for name, value in _attributes(truth).items() if isinstance(value, np.ndarray)},
        **{f"observer.{name}": value for name, value in _attributes(truth.observer).items()},
        **{f"roads.{i}": line for i, line in enumerate(truth.roads)},
    }
    meta = {"key": key, "ids": truth.ids, "source": truth.source, "audit": truth.audit, "roads": len(truth.roads)}
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
