"""The file of a suite: scenarios with their digests, metrics that rank, and built-in trackers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from trackbench.base.config import Config, Name, Problem
from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.files import read_text
from trackbench.runner.assemble import scene_fingerprint
from trackbench.scenario import Scenario
from trackbench.scenario.config_file import read_config
from trackbench.scenario.keys import Margin
from trackbench.scenario.load import scenario_of
from trackbench.scenario.shipped import find_scenario
from trackbench.scenario.worlds import World
from trackbench.truth import LoadedTruth

#: Folder of the suites that come with the package.
FOLDER = Path(__file__).parent / "suites"
Kind = Literal["single", "traffic"]
KINDS: tuple[Kind, ...] = ("single", "traffic")
Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class ScenarioEntry(Config):
    """Scenario of a suite, in one world (drivers and sensors); its content never changes under its id."""

    id: Name
    scenario: str = Field(description="A file beside the suite's, or the name of a scenario of the package.")
    world: World | None = None
    sha256: Digest = Field(description="Digest of the scenario's file.")
    truth: Digest = Field(description="Digest of the motion in all scenes, to a millimetre at each whole second.")
    scans: Digest = Field(description="Digest of the measurements in all runs, to a thousandth of m, rad and m/s.")


class SuiteFile(Config):
    """Contents of a suite's file, such as its scenarios, metrics, margin and built-in trackers."""

    id: Name
    version: int = Field(ge=1)
    title: str
    authors: list[str] = Field(min_length=1)
    released: str = Field(pattern=r"^\d{4}-\d{2}-\d{2}$", description="Date, such as 2026-11-30.")
    licence: str
    metrics: dict[Kind, list[str]] = Field(description="Metrics that a page shows, by kind; the first one ranks.")
    margin: Margin = Field(description="Differences between trackers that do not matter.")
    smoke: list[str] = Field(min_length=1, description="Scenarios that take a minute together.")
    scenarios: list[ScenarioEntry] = Field(min_length=1)
    trackers: dict[Kind, dict[Name, dict[str, Any]]] = Field(
        default_factory=dict, description="Built-in trackers by kind and name, as a scenario has them."
    )

    def problems(self) -> Iterator[Problem]:
        ids = [item.id for item in self.scenarios]
        for index, name in enumerate(ids):
            if name in ids[:index]:
                yield Problem(("scenarios", index, "id"), f"{name} is there already")
        for index, name in enumerate(self.smoke):
            if name not in ids:
                yield Problem(("smoke", index), f"there is no scenario {name!r}; {nearest_choices(name, ids)}")


@dataclass(frozen=True)
class SuiteScenario:
    """Scenario of a suite, with the text of its file."""

    suite: Suite
    stated: ScenarioEntry
    file: Path
    text: str

    @property
    def id(self) -> str:
        """Id of the scenario in its world, and name of its folder in an entry."""
        return self.stated.id

    @cached_property
    def plain(self) -> Scenario:
        """Scenario with the trackers of its file."""
        return self.loaded(None, self.file.parent)

    @property
    def kind(self) -> Kind:
        """Kind of the scenario: objects with known identities (single), or hidden identities (traffic)."""
        return "single" if self.plain.config.sensing.identities == "known" else "traffic"

    def loaded(self, trackers: Mapping[str, Any] | None, folder: Path) -> Scenario:
        """Return the scenario with other trackers.

        Args:
            trackers: values of the scenario key ``trackers``, by name; None for the trackers of the file.
            folder: folder in which the trackers' modules and files are searched first.

        Raises:
            InputError: a tracker does not fit the scenario; the error names its key.
        """
        overrides = [f"world={self.stated.world}"] if self.stated.world is not None else []
        overrides.append(f"score.margin={json.dumps(self.suite.stated.margin.model_dump())}")
        overrides += [] if trackers is None else [f"trackers={json.dumps(trackers)}"]
        return scenario_of(self.text, folder / self.file.name, overrides)

    def why_other_truth(self, truths: Sequence[LoadedTruth]) -> str | None:
        """Return why truths differ from the suite's, or None if they are equal."""
        digest = digest_of(scene_fingerprint(item.truth, item.measurements) for item in truths)
        return None if digest == self.stated.truth else "has another motion than in the suite: another simulator?"

    def why_other_scans(self, fingerprints: Sequence[str]) -> str | None:
        """Return why the rounded fingerprints of measurements differ from the suite's, or None if they are equal."""
        is_other = digest_of(fingerprints) != self.stated.scans
        return "has other measurements than in the suite: another version?" if is_other else None


@dataclass(frozen=True)
class Suite:
    """Suite of scenarios that never change: the content of its file, with path and digest."""

    stated: SuiteFile
    path: Path
    sha256: str
    """Digest of the file."""
    argument: str
    """Id or file that names the suite on the command line."""

    @property
    def identity(self) -> dict[str, Any]:
        """Id, version and digest of the suite, which each entry in the suite repeats."""
        return {"id": self.stated.id, "version": self.stated.version, "sha256": self.sha256}

    @cached_property
    def scenarios(self) -> dict[str, SuiteScenario]:
        """Scenarios by id, in the order of the file.

        Raises:
            InputError: the file of a scenario has changed, or is missing.
        """
        scenarios = {}
        for number, item in enumerate(self.stated.scenarios):
            beside = self.path.parent / item.scenario
            file = beside if beside.is_file() else find_scenario(item.scenario)
            text = read_text(file)
            if hashlib.sha256(text.encode()).hexdigest() != item.sha256:
                message = f"{file} has another sha256: a scenario never changes under its id"
                raise InputError(message, file=self.path, key=f"scenarios.{number}.sha256")
            scenarios[item.id] = SuiteScenario(self, item, file, text)
        return scenarios

    def chosen(self, only: Sequence[str]) -> list[SuiteScenario]:
        """Return the named scenarios in the order of the suite; all scenarios if no name is given.

        Args:
            only: ids of scenarios, kinds of scenarios, or ``smoke``.

        Raises:
            InputError: a name is unknown.
        """
        wanted: set[str] = set()
        for name in only:
            ids = {key for key, item in self.scenarios.items() if name in (key, item.kind)}
            ids |= {*self.stated.smoke} if name == "smoke" else set()
            if not ids:
                hint = nearest_choices(name, [*self.scenarios, *KINDS, "smoke"])
                raise InputError(f"no scenario {name!r} in {self.stated.id}; {hint}", key="--only")
            wanted |= ids
        return [item for key, item in self.scenarios.items() if not only or key in wanted]


def digest_of(fingerprints: Iterable[str]) -> str:
    """Return the sha256 over all fingerprints."""
    return hashlib.sha256(" ".join(fingerprints).encode()).hexdigest()


def shipped_suites() -> dict[str, Path]:
    """Return the file of each suite that comes with the package, by id."""
    return {file.stem: file for file in sorted(FOLDER.glob("*.yaml"))}


def find_suite(argument: str) -> Suite:
    """Return the suite with an id, or in a YAML file.

    Raises:
        InputError: the suite is unknown, or its file has an error.
    """
    path = Path(argument) if Path(argument).suffix in (".yaml", ".yml") else shipped_suites().get(argument)
    if path is None:
        raise InputError(f"there is no suite {argument!r}; {nearest_choices(argument, shipped_suites())}", key="ID")
    stated, text = read_config(SuiteFile, path)
    return Suite(stated, path, hashlib.sha256(text.encode()).hexdigest(), argument)
