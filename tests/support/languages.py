"""The shipped examples in C and C++, compiled."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import pytest
from tests.support.places import ROOT

#: What has been compiled, by what it was compiled from, so that each source is compiled once.
BUILT = ROOT / ".pytest_cache" / "d" / "compiled"
LANGUAGES = Path(str(files("trackbench.subjects.templates").joinpath("languages")))
SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def compiled(folder: Path, source: str, *flags: str) -> Path:
    """A source file of a folder that has the headers, as a program beside it.

    Skips where there is no compiler.
    """
    compiler = shutil.which("g++" if source.endswith(".cpp") else "gcc")
    if compiler is None:
        pytest.skip("there is no compiler")
    output = folder / Path(source).stem
    standard = ["-std=c++17"] if source.endswith(".cpp") else ["-std=gnu99"]
    flags = ("-DTRACKBENCH_PROGRAM", "-Wall", "-Wextra", "-Wpedantic", "-Werror", *flags)
    command = [compiler, "-O2", *standard, *flags, source, "-o", output.name, "-lm"]
    content = [file.read_bytes() for file in (folder / source, *sorted(LANGUAGES.glob("*.h*")), Path(compiler))]
    built = BUILT / hashlib.sha256(b"".join([*content, repr(command).encode()])).hexdigest()
    if not built.exists():
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        BUILT.mkdir(parents=True, exist_ok=True)
        os.replace(shutil.copy2(output, f"{built}.{os.getpid()}"), built)
    return Path(shutil.copy2(built, output))


def examples(folder: Path) -> None:
    """Write the headers and the examples, whose class is Mine."""
    for file in LANGUAGES.iterdir():
        text = file.read_text(encoding="utf-8")
        name = file.name.removesuffix(".j2")
        (folder / name).write_text(text.replace("{{ cls }}", "Mine").replace("{{ name }}", "mine"), encoding="utf-8")
