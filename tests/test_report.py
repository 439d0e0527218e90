"""The report, the Markdown table and the terminal table of one run."""

from __future__ import annotations

import io
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from rich.console import Console

from trackbench.report import html, markdown
from trackbench.report.console import print_summary
from trackbench.report.significance import Differences, letters
from trackbench.results import RunResult, to_json

SENSORS = {"front_radar": 3, "roof_lidar": 2}
RMSE = {"ukf_ctrv": 0.382, "ekf_ctrv": 0.385, "ekf_cv": 0.412, "ekf_tight": 0.63, "alpha_beta": 0.71, "raw": 1.93}
NEES = {"ukf_ctrv": 4.02, "ekf_ctrv": 4.1, "ekf_cv": 3.1, "ekf_tight": 96.0, "alpha_beta": None, "raw": 4.0}
TIED = {frozenset(("ukf_ctrv", "ekf_ctrv"))}
BOUND = 0.35
TIME = np.arange(0, 20.01, 0.05)


def metric(value: float | None, unit: str, reason: str = "") -> dict[str, Any]:
    if value is None:
        return {"value": None, "unit": unit, "reason": reason}
    return {"value": value, "unit": unit, "ci95": [0.98 * value, 1.02 * value]}


def chi_square(mean: float | None, dof: int, reason: str = "") -> dict[str, Any]:
    if mean is None:
        return {"mean": None, "dof": dof, "unit": "1", "reason": reason}
    low, high = 0.9 * dof, 1.1 * dof
    verdict = "pessimistic" if mean < low else "optimistic" if mean > high else "consistent"
    return {"mean": mean, "dof": dof, "unit": "1", "bounds95": [low, high], "ci95": None, "verdict": verdict}


def tracker(name: str, place: int) -> dict[str, Any]:
    rmse, nees = RMSE[name], NEES[name]
    no_innovation = "the tracker gives no innovation of this sensor"
    scale = None if name in ("raw", "alpha_beta") else (nees or 4.0) / 4
    return {
        "name": name,
        "describe": f"{name.replace('_', ', ')}, acceleration sigma 3 m/s^2, all sensors",
        "failed": None,
        "metrics": {
            "position_rmse": metric(rmse, "m"),
            "velocity_rmse": metric(None if name == "raw" else 2.1 * rmse, "m/s", "raw gives no velocity"),
            "course_rmse": metric(4.0 * rmse, "deg"),
            "rmse": {axis: metric(0.7 * rmse, "m") for axis in ("px", "py", "vx", "vy")},
            "nees": chi_square(nees, 4, "the tracker gives no covariance"),
            "nis": {
                sensor: {
                    **chi_square(scale and dof * scale, dof, no_innovation),
                    "inside95": scale and min(0.99, 0.95 / scale),
                }
                for sensor, dof in SENSORS.items()
            },
            "whiteness": {
                sensor: {**metric(scale and 0.011, "1", no_innovation), "verdict": "white"} for sensor in SENSORS
            },
            "position_bound": metric(BOUND, "m"),
            "velocity_bound": metric(0.8, "m/s"),
            "position_efficiency": metric(rmse / BOUND, "1"),
            "velocity_efficiency": metric(1.2, "1"),
            "coverage": metric(0.99, "1"),
            "step_time": metric(0.2 * 2.5**place, "us"),
        },
        "health": {
            "diverged_runs": 3 if name == "ekf_tight" else 0,
            "repaired_covariances": 7 if name == "ekf_tight" else 0,
            "repaired_runs": 0,
            "non_finite_estimates": 0,
        },
    }


def failed_tracker() -> dict[str, Any]:
    nothing = {"value": None, "unit": "1", "reason": "the tracker failed"}
    keys = ("position_rmse", "velocity_rmse", "course_rmse")
    return {
        "name": "mine",
        "describe": "mypkg:Mine, all sensors",
        "failed": {
            "cause": "ValueError: matrix <3> is singular",
            "step": 12,
            "time_s": 0.6,
            "sensor": "roof_lidar",
            "run": 0,
            "object": "v1",
        },
        "metrics": {**dict.fromkeys(keys, nothing), "nees": {**nothing, "mean": None}, "nis": None},
        "health": {"non_finite_estimates": 0},
    }


def make_summary() -> dict[str, Any]:
    names = list(RMSE)
    differences = [
        {
            "a": a,
            "b": b,
            "metric": "position_rmse",
            "unit": "m",
            "value": RMSE[a] - RMSE[b],
            "ci95": [RMSE[a] - RMSE[b] - 0.005, RMSE[a] - RMSE[b] + 0.005],
            "p_value": 0.3 if {a, b} in TIED else 1e-9,
            "verdict": "no difference shown" if {a, b} in TIED else "a better" if RMSE[a] < RMSE[b] else "b better",
        }
        for i, a in enumerate(names)
        for b in names[i + 1 :]
    ]
    expectation = {"tracker": "ekf_cv", "metric": "position_rmse", "operator": "below"}
    return {
        "schema_version": 1,
        "scenario": {
            "name": "highway_overtake",
            "description": "Four cars on a highway, one overtakes.",
            "file": "highway.yaml",
            "text": "name: highway_overtake\nsensors: {}  # <b>not bold</b>\n",
            "overrides": [],
        },
        "seed": 7,
        "runs": 100,
        "versions": {"trackbench": "0.1.0", "numpy": "2.4.6"},
        "command": "trackbench run scenarios/highway.yaml --runs 100",
        "fingerprint": "sha256:" + "0123456789abcdef" * 4,
        "truth": {
            "source": "highway-env",
            "env": "highway-v0",
            "objects": ["v1", "v2", "v3"],
            "steps": len(TIME),
            "dt": 0.05,
            "duration_s": 20.0,
            "audit": {
                "verdict": "repaired",
                "velocity_error_before": {"max_mps": 5.3, "mean_mps": 0.2, "object": "v2", "time_s": 4.5},
                "velocity_error_after": {"max_mps": 0.012, "mean_mps": 0.001, "object": "v2", "time_s": 4.5},
                "jumps": [{"object": "v3", "time_s": 15.0, "distance_m": 1.4}],
                "clock_drift_s": 0.0,
                "repaired": {
                    "velocity_from_course_and_slip": ["v1", "v2"],
                    "velocity_from_displacement": [],
                    "cut_at_jump": ["v3"],
                    "own_clock": False,
                },
            },
            "cached": True,
        },
        "sensors": {
            "front_radar": {"kind": "radar", "dof": 3, "rate_hz": 20.0, "preset": "bosch_lrr3", "detection_rate": 0.93},
            "roof_lidar": {"kind": "lidar", "dof": 2, "rate_hz": 10.0, "preset": None, "detection_rate": None},
        },
        "shown_run": 0,
        "trackers": [*(tracker(name, i) for i, name in enumerate(reversed(names))), failed_tracker()],
        "ranking": [*names, "mine"],
        "differences": differences,
        "expectations": [
            {**expectation, "limit": 0.5, "value": 0.412, "passed": True, "text": "ekf_cv position_rmse below 0.5"},
            {**expectation, "limit": 0.4, "value": 0.412, "passed": False, "text": "ekf_cv position_rmse below 0.4"},
        ],
        "passed": False,
        "artifacts": {},
    }


def make_tables() -> dict[str, pa.Table]:
    rng = np.random.default_rng(1)
    settling = 1 + 8 * np.exp(-TIME / 0.4)
    steps, nis, estimates = [], [], []
    paths = {f"v{i}": np.stack([20 * i + (22 + i) * TIME, 4 * i + 2 * np.tanh(TIME - 8)]) for i in (1, 2, 3)}
    for name, rmse in RMSE.items():
        error = rmse * settling * (1 + 0.05 * rng.standard_normal(TIME.size))
        nees = np.full(TIME.size, np.nan) if NEES[name] is None else NEES[name] * rng.normal(1, 0.08, TIME.size)
        steps.append(
            {
                "tracker": [name] * TIME.size,
                "time_s": TIME,
                "position_rmse_m": error,
                "velocity_rmse_mps": 2.1 * error,
                "position_p10_m": 0.4 * error,
                "position_p90_m": 1.6 * error,
                "nees_mean": nees,
                "nees_low": np.full(TIME.size, 3.6),
                "nees_high": np.full(TIME.size, 4.4),
                "position_bound_m": BOUND * settling,
                "velocity_bound_mps": 0.8 * settling,
            }  # fmt: skip
        )
        if name not in ("raw", "alpha_beta"):
            nis += [
                {
                    "tracker": [name] * TIME.size,
                    "sensor": [sensor] * TIME.size,
                    "time_s": TIME,
                    "nis_mean": dof * (NEES[name] or 4) / 4 * rng.normal(1, 0.08, TIME.size),
                    "nis_low": np.full(TIME.size, 0.9 * dof),
                    "nis_high": np.full(TIME.size, 1.1 * dof),
                }  # fmt: skip
                for sensor, dof in SENSORS.items()
            ]
        for target, path in paths.items():
            noise = rmse * rng.standard_normal(path.shape)
            estimates.append(
                {
                    "tracker": [name] * TIME.size,
                    "object": [target] * TIME.size,
                    "time_s": TIME,
                    "px_m": path[0] + noise[0],
                    "py_m": path[1] + noise[1],
                    "position_error_m": np.hypot(*noise),
                }  # fmt: skip
            )
    bodies = {**paths, "observer": np.stack([21 * TIME, np.full(TIME.size, 4.0)])}
    truth = [
        {
            "object": [name] * TIME.size,
            "role": ["observer" if name == "observer" else "target"] * TIME.size,
            "time_s": TIME,
            "alive": np.full(TIME.size, True),
            "px_m": path[0],
            "py_m": path[1],
        }  # fmt: skip
        for name, path in bodies.items()
    ]
    roads = [{"line": np.full(2, i), "x_m": [0, 600], "y_m": [4 * i - 2, 4 * i - 2]} for i in range(5)]
    parts = {"steps": steps, "nis": nis, "estimates": estimates, "truth": truth, "roads": roads}
    return {
        name: pa.table({key: np.concatenate([row[key] for row in rows]) for key in rows[0]})
        for name, rows in parts.items()
    }


@pytest.fixture(scope="module")
def result() -> RunResult:
    made = RunResult(make_summary(), make_tables())
    to_json(made.summary)
    return made


class Page(HTMLParser):
    """What the tests look at in a page: elements with their attributes, nesting, and text."""

    VOID = ("meta", "link", "input", "br")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None], tuple[str, ...]]] = []
        self.rows: list[list[str]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        assert self._open == [], "every element is closed"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs), tuple(self._open)))
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs), tuple(self._open)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self._open:
            self.text += data
        if self._open and "td" in self._open and "small" not in self._open and "svg" not in self._open:
            self.rows[-1][-1] += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes, _ in self.elements if name == tag]


@pytest.fixture(scope="module")
def page(result: RunResult) -> Page:
    return Page(html.render(result))


def ranked_rows(page: Page) -> dict[str, list[str]]:
    return {row[1]: row for row in page.rows if row and row[0].isdigit()}


def test_the_page_loads_nothing(result: RunResult, page: Page) -> None:
    links = [value for _, attributes, _ in page.elements for key, value in attributes.items() if key in ("href", "src")]
    assert all(str(link).startswith(("#", "data:")) for link in links)
    assert not {"script", "iframe", "img"} & {tag for tag, _, _ in page.elements}
    text = html.render(result)
    assert "http://" not in text
    assert "https://" not in text
    assert "@import" not in text


def test_figures_have_captions_and_alternatives(page: Page) -> None:
    inside = [tag for tag, _, parents in page.elements if "figure" in parents]
    figures, drawings = page.all("figure"), page.all("svg")
    assert len(figures) == len(drawings) == inside.count("figcaption") == 8
    assert all(drawing["role"] == "img" and len(str(drawing["aria-label"])) > 20 for drawing in drawings)
    identities = [attributes["id"] for _, attributes, _ in page.elements if "id" in attributes]
    assert len(identities) == len(set(identities))


def test_references_inside_drawings_resolve(page: Page) -> None:
    identities = {attributes.get("id") for _, attributes, _ in page.elements}
    used = [str(a["clip-path"])[5:-1] for _, a, _ in page.elements if "clip-path" in a]
    used += [str(a["href"])[1:] for tag, a, _ in page.elements if tag == "use"]
    assert used
    assert set(used) <= identities


def test_drawings_take_the_colours_of_the_page(result: RunResult) -> None:
    text = html.render(result)
    assert "currentColor" in text
    assert not any(stand_in in text for stand_in in ("#010203", "#020304", "#030405"))


def test_the_page_is_the_same_every_time(result: RunResult) -> None:
    assert html.render(result) == html.render(RunResult(make_summary(), make_tables()))


def test_ranked_values_are_those_of_the_result(page: Page) -> None:
    rows = ranked_rows(page)
    assert list(rows) == list(RMSE)
    assert {name: float(row[3]) for name, row in rows.items()} == RMSE
    assert rows["ekf_tight"][6] == "96.00"
    assert rows["ekf_tight"][10:12] == ["3", "7"]
    assert [row[2] for row in rows.values()] == ["a", "a", "b", "c", "d", "e"]
    assert "0.374 to 0.390" in page.text


def test_missing_values_are_na_with_their_reason(page: Page) -> None:
    assert ranked_rows(page)["raw"][4].startswith("n/a")
    assert ranked_rows(page)["alpha_beta"][6].startswith("n/a")
    reasons = [abbreviation["title"] for abbreviation in page.all("abbr")]
    assert "raw gives no velocity" in reasons
    assert page.text.count("raw gives no velocity") == 1
    assert "None" not in page.text
    assert "nan" not in page.text


def test_verdicts_in_words(page: Page) -> None:
    assert "ukf_ctrv is the most accurate in position: 0.382 m RMSE" in page.text
    assert "no difference was shown between it and ekf_ctrv." in page.text
    assert "0.412 m position RMSE, 18\N{NO-BREAK SPACE}% above the Cramér-Rao bound; pessimistic" in page.text
    assert "diverged in 3 of 100 runs; covariance repaired 7 times." in page.text
    assert "1 of 2 expectations failed" in page.text
    assert "contradicted the motion by up to 5.3 m/s (v2 at 4.50 s)" in page.text
    assert "v3 jumps by 1.4 m at 15.00 s" in page.text


def test_a_failed_tracker_is_shown_with_its_cause(page: Page) -> None:
    assert "ValueError: matrix <3> is singular (step 12, 0.60 s, sensor roof_lidar, run 0, object v1)" in page.text
    assert "mine" not in ranked_rows(page)


def test_text_is_escaped() -> None:
    summary = make_summary()
    attack = "<script>alert('x')</script>"
    summary["scenario"] |= {"name": attack, "description": attack, "text": attack}
    summary["truth"]["objects"][0] = attack
    tables = make_tables()
    tables["truth"] = tables["truth"].set_column(0, "object", pa.array([attack] * tables["truth"].num_rows))
    page = Page(html.render(RunResult(summary, tables)))
    assert not page.all("script")
    assert page.text.count(attack) >= 4


def test_every_tracker_failed() -> None:
    summary = make_summary()
    summary |= {"trackers": [failed_tracker()], "ranking": ["mine"], "differences": []}
    empty = pa.table({})
    page = Page(html.render(RunResult(summary, {**make_tables(), "steps": empty, "nis": empty, "estimates": empty})))
    assert "No tracker finished." in page.text
    assert "is singular" in page.text
    assert [figure["id"] for figure in page.all("figure")] == ["map"]


def test_one_run_gives_no_intervals() -> None:
    summary = make_summary()
    for entry in summary["trackers"]:
        for value in entry["metrics"].values():
            if isinstance(value, dict) and "ci95" in value:
                value["ci95"] = None
    for entry in summary["differences"]:
        entry |= {"ci95": None, "p_value": 1.0, "verdict": "no difference shown"}
    page = Page(html.render(RunResult(summary, make_tables())))
    assert {row[2] for row in ranked_rows(page).values()} == {"a"}
    assert "95 % interval 0" not in page.text


def test_markdown_table(result: RunResult) -> None:
    lines = markdown.table(result).splitlines()
    assert lines[0].count("|") == lines[2].count("|")
    assert lines[2].startswith("| 1 | **ukf_ctrv** | a | 0.382 (0.374 to 0.390) |")
    assert "1. n/a: the tracker gives no covariance" in lines
    assert any(line.startswith("- **mine**: ValueError: matrix \\<3\\> is singular") for line in lines)


@pytest.mark.parametrize("width", [80, 120])
def test_terminal_output_fits(result: RunResult, width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    output = io.StringIO()
    print_summary(result, Console(file=output, width=width))
    text = output.getvalue()
    assert max(len(line) for line in text.splitlines()) <= width
    assert "\x1b" not in text
    assert all(name in text for name in (*RMSE, "mine"))
    assert "0.412 ±0.008" in text
    assert "FAILED ekf_cv position_rmse below 0.4: 0.412" in text
    assert "passed ekf_cv position_rmse below 0.5: 0.412" in text
    assert "FAILED mine: ValueError: matrix <3> is singular" in text


def test_terminal_colours_only_where_wanted(result: RunResult, monkeypatch: pytest.MonkeyPatch) -> None:
    def printed(**options: Any) -> str:
        output = io.StringIO()
        print_summary(result, Console(file=output, width=80, force_terminal=True, **options))
        return output.getvalue()

    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b[31m" in printed(color_system="standard") or "\x1b[1;31m" in printed(color_system="standard")
    monkeypatch.setenv("NO_COLOR", "1")
    assert "31m" not in printed()


def test_letters_say_exactly_who_differs() -> None:
    names = ["a", "b", "c", "d"]
    real = {("a", "c"), ("a", "d"), ("b", "d")}
    entries = [
        {
            "a": x,
            "b": y,
            "value": -1.0,
            "ci95": [-2, 0],
            "verdict": "a better" if (x, y) in real else "no difference shown",
        }
        for i, x in enumerate(names)
        for y in names[i + 1 :]
    ]
    found = letters(names, Differences(entries))
    for i, x in enumerate(names):
        for y in names[i + 1 :]:
            assert bool(set(found[x]) & set(found[y])) == ((x, y) not in real)
    assert found == {"a": "a", "b": "ab", "c": "bc", "d": "c"}
