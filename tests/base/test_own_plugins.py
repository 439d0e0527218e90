"""Motion models, sensors and truth sources of a stranger's, in one file beside the scenario."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import ROOT

from trackbench.base.errors import InputError
from trackbench.base.plugins import Registry
from trackbench.models.motion import MOTION_MODELS
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.published import TRACKERS, check_tracker_options
from trackbench.truth import TRUTH_SOURCES

PACKAGE = ROOT / "tests" / "plugin_package"
Write = Callable[[Path, str], str]
Cli = Callable[..., Any]

SCENARIO = """\
name: strange
truth: {{source: "{truth}:Weave", cars: 4, duration_s: 1, rate_hz: 5}}
sensors:
  sonar: {{type: "{sensor}:Sonar", rate_hz: 5, range_sigma_m: 0.3, bearing_sigma_deg: 0.5}}
trackers:
  ekf: {{filter: ekf, motion: "{motion}:Singer", acceleration_sigma_mps2: 2, time_constant_s: 3}}
monte_carlo: {{runs: 700, seed: 1}}
score: {{settle_s: 0}}
"""


@pytest.fixture
def strange(tmp_path: Path, write_module: Write) -> Path:
    """A scenario in a folder of its own, with its modules beside it; the test runs elsewhere."""
    folder = tmp_path / "scenario"
    folder.mkdir()
    names = {
        kind: write_module(folder, (PACKAGE / f"example_{kind}.py").read_text(encoding="utf-8"))
        for kind in ("truth", "sensor", "motion")
    }
    (folder / "strange.yaml").write_text(SCENARIO.format(**names), encoding="utf-8")
    return folder / "strange.yaml"


def test_they_run_in_one_process_and_in_two_with_the_same_numbers(strange: Path, cli: Cli) -> None:
    found = []
    for workers in ("1", "2"):
        done = cli("run", strange, "--json", "--no-recording", "--workers", workers)
        assert done.status == 0, done.err
        (ekf,) = json.loads(done.out)["trackers"]
        found.append(ekf["metrics"]["position_rmse"])
    assert found[0] == found[1]
    assert 0 < found[0]["value"] < 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("time_constant_s: 3", "time_constant_ms: 3000", "use time_constant_s (seconds): 3"),
        (
            "acceleration_sigma_mps2: 2, ",
            "",
            "acceleration_sigma_mps2: missing; standard deviation of",
        ),
        (":Singer", ":Singr", "trackers.ekf.motion: module '{motion}' has no 'Singr': did you mean 'Singer'?"),
        (":Sonar", ":linalg", "'{sensor}:linalg' is no sensor: it must be a subclass of trackbench.models.sensors."),
        ("cars: 4", "cars: 40", "truth.cars: 40 is not possible: it must be at most 20"),
    ],
)
def test_mistakes_are_located(strange: Path, cli: Cli, old: str, new: str, message: str) -> None:
    text = strange.read_text(encoding="utf-8")
    names = {kind: text.split(f":{cls}")[0].split('"')[-1] for kind, cls in (("motion", "Singer"), ("sensor", "Sonar"))}
    assert old in text
    strange.write_text(text.replace(old, new, 1), encoding="utf-8")
    done = cli("check", strange)
    assert done.status == 2
    assert message.format(**names) in done.err
    assert done.err.count("\n") == 1


@pytest.mark.parametrize("registry", [MOTION_MODELS, SENSOR_MODELS, TRUTH_SOURCES, TRACKERS])
@pytest.mark.parametrize("reference", ["os:system", "os:path", "builtins:print", "subprocess:run"])
def test_what_is_something_else_is_refused_without_being_called(registry: Registry[Any], reference: str) -> None:
    with pytest.raises(InputError, match=f"'{reference}' is no {registry.what}: "):
        registry.get(reference)


GATED = """
from pydantic import BaseModel, ConfigDict, Field, field_validator

class Gated:
    class Options(BaseModel):
        model_config = ConfigDict(extra="forbid")
        class Gate(BaseModel):
            model_config = ConfigDict(extra="forbid")
            size_m: float = 1
        gate: Gate = Gate()
        sigma_m: float = Field(1, gt=0)
        count: int = 1
        on: bool = True

        @field_validator("count")
        @classmethod
        def _odd(cls, count):
            if count % 2 == 0:
                raise ValueError("must be odd")
            return count

    def step(self, state, scan): ...
"""


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sigma": 2}, "sigma: unknown key; use sigma_m (metres)"),
        ({"sigma_cm": 2}, "sigma_cm: unknown key; use sigma_m (metres): 0.02"),
        ({"gate": {"size_cm": 3}}, "gate.size_cm: unknown key; use size_m (metres): 0.03"),
        ({"sigma_m": "3 cm"}, "sigma_m: a number in metres is needed, not '3 cm'"),
        ({"sigma_m": -1}, "sigma_m: -1 is not possible: it must be above 0"),
        ({"count": 1.5}, "count: a whole number is needed, not 1.5"),
        ({"count": 2}, "count: must be odd"),
        ({"on": "maybe"}, "on: true or false is needed, not 'maybe'"),
        ({"gate": 3}, "gate: a mapping of keys to values is needed, not 3 (keys: size_m)"),
    ],
)
def test_options_of_a_plain_pydantic_model_are_explained_as_built_in_ones_are(
    tmp_path: Path, write_module: Write, options: dict[str, Any], message: str
) -> None:
    module = write_module(tmp_path, GATED)
    with pytest.raises(InputError) as caught:
        check_tracker_options(f"{module}:Gated", options, tmp_path)
    assert str(caught.value) == message


def test_a_check_starts_no_tracker(tmp_path: Path, write_module: Write) -> None:
    code = "class Loud:\n    def __init__(self, gain, **rest):\n        raise SystemExit\n"
    module = write_module(tmp_path, code + "    def step(self, state, scan):\n        raise SystemExit\n")
    check_tracker_options(f"{module}:Loud", {"gain": 1, "other": 2}, tmp_path)
    with pytest.raises(InputError, match="missing a required argument: 'gain'"):
        check_tracker_options(f"{module}:Loud", {}, tmp_path)


MODEL = """
from trackbench.models.motion import ConstantVelocity
class {name}(ConstantVelocity):
    {body}
"""


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("components = ('px', 'py', 'vx', 'vy', 'tilt')", "its first_sigmas do not say how uncertain tilt is"),
        ("driving_noise = ('jerk_sigma_mps3',)", "its driving_noise names 'jerk_sigma_mps3', which is no option of it"),
    ],
)
def test_an_unfinished_motion_model_says_what_is_missing(
    tmp_path: Path, write_module: Write, body: str, message: str
) -> None:
    module = write_module(tmp_path, MODEL.format(name="Unfinished", body=body))
    with pytest.raises(InputError, match=f"is no motion model: {message}"):
        MOTION_MODELS.get(f"{module}:Unfinished", tmp_path)


def test_one_name_published_twice_is_ambiguous(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("one", "two"):
        info = tmp_path / f"{package}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[trackbench.sensors]\nsonar = {package}:Sonar\n")
    monkeypatch.syspath_prepend(tmp_path)
    reason = "'sonar' is published 2 times, as one:Sonar and as two:Sonar: name one of them"
    with pytest.raises(InputError, match=reason):
        SENSOR_MODELS.get("sonar")
    assert SENSOR_MODELS.failures() == {"sonar": reason}
    assert "radar" in SENSOR_MODELS.loaded()
