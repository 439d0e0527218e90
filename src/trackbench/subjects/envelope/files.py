"""The folder of an envelope: its claim, the values of its runs, its pages and its counter-examples."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
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

#: Name of a run's recording, which the subject ``recording`` writes.
RECORDING = "recording.rrd"


def folder_of(scenario: str, out: Path) -> Path:
    """Return the path of the folder, in ``out``, into which a scenario's envelope is written."""
    return out / f"{scenario}-envelope"


def looks_of(scenario: str, out: Path) -> Path:
    """Return the path of the folder that stores the finished runs of an envelope until the envelope is written."""
    return out / f".{scenario}-envelope.looks"


def require_envelope_folder(scenario: str, out: Path) -> None:
    """Refuse, before any work, an envelope whose folder cannot be written.

    Raises:
        InputError: the folder cannot be written, or is not an envelope's.
    """
    results.require_writable(out)
    results.require_replaceable(folder_of(scenario, out), CLAIM)


def save_envelope(envelope: Envelope, out: Path, recording: bool = True) -> Path:
    """Write the folder of an envelope in ``out``, whole or not at all; return its path.

    Raises:
        OutputError: the folder cannot be written.
    """
    folder = folder_of(envelope.claim.scenario, out)
    shown: dict[str, ShownExample] = {}
    examples: dict[str, Callable[[Path], object]] = {}
    for name, example in envelope.shown.items():
        place = f"{COUNTER_EXAMPLES}/{name}"
        result, artifacts = with_artifacts(example.result, () if recording else (RECORDING,))
        shown[name] = example._replace(result=result)
        text = written_with_changes(example.loaded, folder / place)
        own: dict[str, Callable[[Path], object]] = {
            "scenario.yaml": partial(results.write_file, text),
            **result.files(),
            **artifacts,
        }
        examples |= {f"{place}/{file}": write for file, write in own.items()}
    document = envelope_document(replace(envelope, shown=shown))
    files: dict[str, Callable[[Path], object]] = {
        PARTS: partial(_write_parts, envelope),
        # The claim has the hash of the parts, so that it is written after them.
        CLAIM: partial(_write_claim, envelope.claim),
        "envelope.html": partial(results.write_file, to_html(document)),
        "envelope.md": partial(results.write_file, to_markdown(document)),
    }
    results.save_files(files | examples, folder, CLAIM)
    shutil.rmtree(looks_of(envelope.claim.scenario, out), ignore_errors=True)
    return folder


def claim_text(claim: Claim) -> str:
    """Return the claim as JSON."""
    return results.json_text(claim.model_dump(mode="json"))


def _write_claim(claim: Claim, path: Path) -> None:
    results.write_file(claim_text(claim.model_copy(update={"parts": sha256(path.with_name(PARTS))})), path)


def _write_parts(envelope: Envelope, path: Path) -> None:
    import pyarrow.parquet as pq

    pq.write_table(envelope.parts, path, compression="zstd")
