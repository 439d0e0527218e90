"""The folder of an envelope: its claim, the values of its runs, and its pages; the files that its scenario names."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

from trackbench import results
from trackbench.api.save import with_artifacts
from trackbench.document.html import to_html
from trackbench.document.markdown import to_markdown
from trackbench.results.folder import sha256
from trackbench.scenario.load import written_with_changes
from trackbench.subjects.envelope.claim import CLAIM, PARTS, Claim, Envelope
from trackbench.subjects.envelope.counter_models import COUNTER_EXAMPLES, ShownExample
from trackbench.subjects.envelope.report import envelope_document

#: The file of the subject that records a run.
RECORDING = "recording.rrd"


def folder_of(scenario: str, out: Path) -> Path:
    """Where the envelope of a scenario is written."""
    return out / f"{scenario}-envelope"


def looks_of(scenario: str, out: Path) -> Path:
    """Where the runs of an envelope are kept until it is written."""
    return out / f".{scenario}-envelope.looks"


def require_envelope_folder(scenario: str, out: Path) -> None:
    """Make sure, before any work, that the folder can be written.

    Raises:
        InputError: it cannot.
    """
    results.require_writable(out)
    results.require_replaceable(folder_of(scenario, out), CLAIM)


def save_envelope(made: Envelope, out: Path, recording: bool = True) -> Path:
    """Write the folder whole, or not at all; returns its place.

    Args:
        made: what is claimed.
        out: in which the folder is made.
        recording: whether each counter-example has one.

    Raises:
        OutputError: it cannot be written.
    """
    folder, document = folder_of(made.claim.scenario, out), envelope_document(made)
    files: dict[str, Callable[[Path], object]] = {
        PARTS: partial(_write_parts, made),
        # After the values of the runs, whose digest it has.
        CLAIM: partial(_write_claim, made.claim),
        "envelope.html": partial(results.write_file, to_html(document)),
        "envelope.md": partial(results.write_file, to_markdown(document)),
    }
    for name, shown in made.shown.items():
        place = f"{COUNTER_EXAMPLES}/{name}"
        own = _files_of(shown, folder / place, recording)
        files |= {f"{place}/{file}": write for file, write in own.items()}
    results.save_files(files, folder, CLAIM)
    shutil.rmtree(looks_of(made.claim.scenario, out), ignore_errors=True)
    return folder


def _files_of(shown: ShownExample, folder: Path, recording: bool) -> dict[str, Callable[[Path], object]]:
    """The scenario of a counter-example, and the folder of its run."""
    text = written_with_changes(shown.loaded, folder)
    left_out = () if recording else (RECORDING,)
    result, artifacts = with_artifacts(shown.result, left_out)
    return {"scenario.yaml": partial(results.write_file, text), **result.files(), **artifacts}


def claim_text(claim: Claim) -> str:
    """The claim as JSON."""
    return results.json_text(claim.model_dump(mode="json"))


def _write_claim(claim: Claim, path: Path) -> None:
    results.write_file(claim_text(claim.model_copy(update={"parts": sha256(path.with_name(PARTS))})), path)


def _write_parts(made: Envelope, path: Path) -> None:
    import pyarrow.parquet as pq

    pq.write_table(made.parts, path, compression="zstd")
