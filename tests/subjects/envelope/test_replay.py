"""A claim that was edited is found: at once where it contradicts itself, else where the edited cell is replayed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from trackbench.base.errors import InputError
from trackbench.subjects.envelope.claim import CLAIM, PARTS, Envelope, hash_of
from trackbench.subjects.envelope.files import save_envelope
from trackbench.subjects.envelope.replay import WITHOUT_PARTS, drawn, verify

Tree = dict[str, Any]
#: The cell that is edited: not near the border, so that its state does not decide which others there are.
CELL = 0


@pytest.fixture(scope="module")
def saved(small_envelope: Envelope, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the small map."""
    return save_envelope(small_envelope, tmp_path_factory.mktemp("replay"))


@pytest.fixture
def folder(saved: Path, tmp_path: Path) -> Path:
    """A copy of it, which a test may change."""
    return shutil.copytree(saved, tmp_path / saved.name)


def edit(folder: Path, change: Callable[[Tree], object]) -> None:
    """Change the claim in a folder."""
    tree = json.loads((folder / CLAIM).read_text())
    change(tree)
    (folder / CLAIM).write_text(json.dumps(tree))


def seed_that(draws: bool, cells: int) -> int:
    """A seed whose draw has the edited cell, or has it not."""
    return next(seed for seed in range(1000) if (CELL in drawn(cells, seed)) == draws)


def tracker(tree: Tree, cell: int = CELL) -> Tree:
    """The one tracker of a cell."""
    (only,) = tree["cells"][cell]["trackers"].values()
    entry: Tree = only
    return entry


def shift(tree: Tree, cell: int, by: float) -> None:
    """A value with its bounds, which then say what they said."""
    (value,) = tracker(tree, cell)["values"]
    for key in ("value", "low", "high"):
        value[key] *= by


def test_a_claim_equals_its_replay(folder: Path, small_envelope: Envelope) -> None:
    for seed in range(3):
        found = verify(folder, seed=seed)
        assert found.passed, found.discrepancies
        assert len(found.replayed) == 2
    assert verify(folder / CLAIM, seed=3).json()["cells"] == len(small_envelope.claim.cells)


def test_the_draw_is_a_tenth_by_its_seed() -> None:
    assert [len(drawn(cells, 1)) for cells in (0, 1, 10, 11, 200)] == [0, 1, 1, 2, 20]
    assert drawn(200, 5) == drawn(200, 5) != drawn(200, 6)
    counts = np.bincount(np.concatenate([drawn(200, seed) for seed in range(2000)]), minlength=200)
    # Binomial, 2,000 draws with probability .1: six standard deviations.
    assert np.all(abs(counts - 200) < 6 * (2000 * 0.1 * 0.9) ** 0.5)


#: What can be seen to be wrong without a run.
CONTRADICTIONS: dict[str, Callable[[Tree], object]] = {
    "state of the cell": lambda tree: tracker(tree).update(state="fails"),
    "state of the value": lambda tree: tracker(tree)["values"][0].update(state="undecided"),
    "both states": lambda tree: (
        tracker(tree).update(state="fails"),
        tracker(tree)["values"][0].update(state="fails"),
    ),
    "value": lambda tree: tracker(tree)["values"][0].update(value=0.07),
    "upper bound past the limit": lambda tree: tracker(tree)["values"][0].update(high=0.9),
    "limit": lambda tree: tree["limits"][0].update(limit=0.24),
    "metric": lambda tree: tree["limits"][0].update(metric="velocity_rmse"),
    "limit in the scenario": lambda tree: tree.update(text=tree["text"].replace("0.25", "0.24")),
    "runs": lambda tree: tracker(tree).update(runs=400),
    "looks": lambda tree: tracker(tree).update(looks=2),
    "runs and looks": lambda tree: tracker(tree).update(looks=2, runs=20),
    "changes": lambda tree: tree["cells"][CELL].update(changes=["sensors.lidar.position_sigma_m=0.01"]),
    "added": lambda tree: tree["cells"][CELL].update(added=True),
    "place": lambda tree: tree["cells"][CELL].update(point=[0.11]),
    "cell left out": lambda tree: tree["cells"].pop(CELL),
    "cell of the scenario left out": lambda tree: tree.update(
        cells=[cell for cell in tree["cells"] if cell["point"] != tree["base"]]
    ),
    "base": lambda tree: tree.update(base=[0.31]),
    "cell twice": lambda tree: tree["cells"].append(tree["cells"][CELL]),
    "confidence": lambda tree: tree.update(confidence=0.99),
    "spent error": lambda tree: tree.update(spent=tree["spent"] / 2),
    "seed": lambda tree: tree.update(seed=2),
    "claim": lambda tree: tree.update(claim="traffic like these"),
    "extents": lambda tree: tree["extents"].append([1, 80]),
    "hash of the runs": lambda tree: tree.update(parts_hash="0" * 64),
    "cause": lambda tree: tracker(tree).update(cause="50 % of the estimates are missing"),
    "fewer cells in the block": lambda tree: tree["envelope"].update(cells=11),
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_a_contradiction_is_found_without_a_replay(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trackbench.subjects.envelope.replay.drawn", lambda *_: [])
    edit(folder, CONTRADICTIONS[name])

    found = verify(folder, seed=0)

    assert not found.passed
    assert not found.replayed


def test_without_a_replay_the_claim_has_no_contradiction(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trackbench.subjects.envelope.replay.drawn", lambda *_: [])

    assert verify(folder, seed=0).passed


def consistent(folder: Path) -> None:
    """A cell that was made better in all that depends on it: its runs, its value, its bounds and the hash."""
    table = pq.read_table(folder / PARTS)
    value = table["value"].to_numpy().copy()
    value[table["cell"].to_numpy() == CELL] *= 0.9
    table = table.set_column(3, "value", pa.array(value))
    pq.write_table(table, folder / PARTS)
    edit(folder, lambda tree: (shift(tree, CELL, 0.9), tree.update(parts_hash=hash_of(table))))


#: What contradicts nothing in the claim.
FORGERIES: dict[str, Callable[[Path], object]] = {
    "runs, value and bounds": consistent,
    "measurements": lambda folder: edit(folder, lambda tree: tree["cells"][CELL].update(measurements=["0" * 16])),
    "lower bound": lambda folder: edit(folder, lambda tree: tracker(tree)["values"][0].update(low=0.01)),
}


@pytest.mark.parametrize("name", FORGERIES)
def test_a_forgery_is_found_where_its_cell_is_drawn(name: str, folder: Path, small_envelope: Envelope) -> None:
    FORGERIES[name](folder)
    cells = len(small_envelope.claim.cells)

    assert not verify(folder, seed=seed_that(True, cells)).passed
    assert verify(folder, seed=seed_that(False, cells)).passed


def test_versions_that_differ_are_told(folder: Path) -> None:
    edit(folder, lambda tree: tree["versions"].update(numpy="1.0"))

    found = verify(folder, seed=1)

    assert found.passed
    assert "numpy 1.0" in found.notes[0]


def test_the_files_that_a_scenario_names_must_be_those_of_the_claim(folder: Path) -> None:
    edit(folder, lambda tree: tree["files"].update({"my_tracker.py": "0" * 64}))

    with pytest.raises(InputError, match=r"my_tracker\.py.*--beside"):
        verify(folder)


def test_a_claim_alone_is_verified_but_for_the_values_of_its_runs(folder: Path) -> None:
    (folder / PARTS).unlink()

    alone = verify(folder / CLAIM, seed=1)

    assert alone.passed
    assert alone.notes == (WITHOUT_PARTS,)
