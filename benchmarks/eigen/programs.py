"""Filters in C++ with Eigen, built here where a compiler and Eigen's headers are found."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np
from benchmarks.engines import Problem, first_belief
from benchmarks.scene import DT
from tests.support import peers

from trackbench.base.types import Array

HERE = Path(__file__).parent
#: By problem, the source of its filter.
SOURCES = {"EKF, CV": "ekf_cv.cpp", "UKF, CTRV": "ukf_ctrv.cpp"}
COMPILERS = ("g++", "clang++", "c++")
#: NDEBUG: without Eigen's checks of its indices.
OPTIONS = ("-std=c++17", "-O3", "-march=native", "-DNDEBUG")
MODELS = (
    f"-DACCELERATION_SIGMA={peers.ACCELERATION_SIGMA}",
    f"-DYAW_ACCELERATION_SIGMA={peers.YAW_ACCELERATION_SIGMA}",
)
FOLDERS = ("/usr/include/eigen3", "/usr/local/include/eigen3", "/opt/homebrew/include/eigen3")


class Missing(Exception):
    """Why nothing could be built."""


class Program(NamedTuple):
    """A filter, and the file of what it is given."""

    executable: Path
    given: Path
    shape: tuple[int, int, int]
    """Of the estimates: runs, steps, components of the state."""

    @property
    def _found(self) -> Path:
        return self.given.with_suffix(".estimates")

    def run(self) -> float:
        """Seconds that the filter takes for all runs."""
        command = [self.executable, self.given, self._found]
        return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)

    def estimates(self) -> Array:
        """``(runs, steps, n)``"""
        self.run()
        return np.fromfile(self._found).reshape(self.shape)


def program(of: Problem, name: str, folder: Path) -> Program:
    """The filter of a problem, built in a folder.

    Raises:
        Missing: there is no compiler, or no Eigen, or they do not go together.
    """
    compiler = os.environ.get("CXX") or next(filter(None, map(shutil.which, COMPILERS)), None)
    if compiler is None:
        raise Missing(f"no C++ compiler ({', '.join(COMPILERS)})")
    source = HERE / SOURCES[name]
    executable = folder / source.stem
    command = [compiler, *OPTIONS, *MODELS, *flags_of_eigen(), str(source), "-o", str(executable)]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True)
    except OSError as error:
        raise Missing(f"{compiler} cannot be run: {error.strerror}") from error
    except subprocess.CalledProcessError as error:
        raise Missing(f"{source.name} was not compiled: {error.stderr.partition(chr(10))[0]}") from error
    given = executable.with_suffix(".measurements")
    return Program(executable, given, _write(of, name, given))


def flags_of_eigen() -> list[str]:
    """Where Eigen's headers are, as a compiler is told.

    Raises:
        Missing: they are not found.
    """
    if shutil.which("pkg-config"):
        asked = subprocess.run(["pkg-config", "--cflags", "eigen3"], check=False, capture_output=True, text=True)
        if asked.returncode == 0:
            return asked.stdout.split()
    for folder in FOLDERS:
        if (Path(folder) / "Eigen" / "Dense").exists():
            return ["-I", folder]
    raise Missing(
        "Eigen's headers were not found (eigen3 of pkg-config, /usr/include/eigen3; libeigen3-dev of Debian and Ubuntu)"
    )


def _write(of: Problem, name: str, file: Path) -> tuple[int, int, int]:
    """What ``passage.hpp`` reads; gives the shape of the estimates."""
    belief = first_belief(of, name)
    noise = {scan.kind: scan.noise_covariance for scan in of.scans}
    measured = np.zeros((of.runs, of.steps, 3))
    for step, scan in enumerate(of.scans):
        measured[:, step, : len(scan.measurement)] = scan.measurement.T
    parts = [
        [of.runs, of.steps, DT],
        noise["radar"],
        noise["lidar"],
        belief.covariance,
        belief.mean.T,
        [scan.kind == "radar" for scan in of.scans],
        measured,
    ]
    np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in parts]).tofile(file)
    return of.runs, of.steps, len(belief.mean)
