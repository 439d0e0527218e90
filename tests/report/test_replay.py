"""The replay in a page: its numbers are those of the result, and what a browser draws of it is where they say."""

from __future__ import annotations

import json
import zlib
from base64 import b64decode
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.browser import drive
from tests.support.example_result import make_result

from trackbench.document import Document
from trackbench.document.html import to_html
from trackbench.document.packed_replay import LIMIT, POSITION, SIGMAS, TIME, packed_replay, series
from trackbench.document.palette import TRUTH_COLOUR
from trackbench.document.replay import ReplayScene
from trackbench.metrics.recorded_run import EstimateMoment
from trackbench.report.first_screen import picture
from trackbench.report.moments import worst_moments
from trackbench.report.result import result_document
from trackbench.results import Result
from trackbench.results.columns import split


@pytest.fixture(scope="module")
def result() -> Result:
    return make_result()


@pytest.fixture(scope="module")
def document(result: Result) -> Document:
    return result_document(result)


@pytest.fixture(scope="module")
def scene(document: Document) -> ReplayScene:
    (replay,) = (figure.replay for figure in document.figures if figure.replay)
    return replay


@pytest.fixture(scope="module")
def worst(result: Result) -> EstimateMoment:
    """The largest error of the two trackers that are shown at first."""
    moments = worst_moments(result)
    return max((moments[name] for name in ("ukf_ctrv", "raw")), key=lambda moment: moment.position_error_m or 0.0)


def unpacked(text: str) -> Any:
    """The content of a packed replay, with its series as arrays."""

    def numbers(item: dict[str, Any]) -> Any:
        if "quantum" not in item:
            return item
        counts = np.array(item["differences"], dtype=np.int64)
        for _ in range(item["order"]):
            counts = np.cumsum(counts)
        return counts * item["quantum"]

    return json.loads(zlib.decompress(b64decode(text)), object_hook=numbers)


def test_what_a_page_has_is_the_result_to_the_quantum(result: Result, scene: ReplayScene) -> None:
    text, every = packed_replay(scene)
    content = unpacked(text)
    assert every == 1
    vehicles = {path["name"]: path for path in content["paths"] if not path["tracker"]}
    for (name,), rows in split(result.tables.truth, "object").items():
        path = vehicles.pop(name)
        np.testing.assert_allclose(path["time"], rows["time_s"], atol=TIME / 2 + 1e-9)
        np.testing.assert_allclose(path["x"], rows["px_m"], atol=POSITION / 2 + 1e-9)
        np.testing.assert_allclose(path["y"], rows["py_m"], atol=POSITION / 2 + 1e-9)
        np.testing.assert_allclose(np.cos(path["heading"]), np.cos(rows["heading_rad"]), atol=1e-3)
        assert path["size"] == [5.0, 2.0]
    assert vehicles == {}
    estimates = [path for path in content["paths"] if path["tracker"]]
    for path, ((tracker, _), rows) in zip(
        estimates, split(result.tables.estimates, "tracker", "object").items(), strict=True
    ):
        assert path["tracker"] == tracker
        np.testing.assert_allclose(path["x"], rows["px_m"], atol=POSITION / 2 + 1e-9)
        np.testing.assert_allclose(path["y"], rows["py_m"], atol=POSITION / 2 + 1e-9)
        covariance = np.array([path["a"] ** 2, path["a"] * path["b"], path["b"] ** 2 + path["c"] ** 2]) / SIGMAS**2
        expected = np.stack([rows["p_00"], rows["p_01"], rows["p_11"]])
        np.testing.assert_allclose(covariance, expected, atol=0.01)
    for item, ((_,), rows) in zip(
        content["measurements"], split(result.tables.measurements, "sensor").items(), strict=True
    ):
        np.testing.assert_allclose(item["x"], rows["x_m"], atol=POSITION / 2 + 1e-9)
        assert not item["false"].any()
    (errors,) = (line["value"] for line in content["lines"] if line["tracker"] == "ekf_cv")
    (rows,) = (rows for (name,), rows in split(result.tables.estimates, "tracker").items() if name == "ekf_cv")
    largest = np.where(rows["due"] > 0, rows["position_error_m"], 0.0).reshape(-1, 3).max(axis=1)
    np.testing.assert_allclose(errors, largest[largest > 0], atol=1e-3)


@pytest.mark.parametrize("use", ["my_tracker:Tracker", ("./my_tracker", "--q", "2"), "published"])
def test_the_users_own_tracker_is_shown_at_first(result: Result, use: str | tuple[str, ...]) -> None:
    best, own, *_, last = (tracker.name for tracker in result.filtering)
    trackers = [t.model_copy(update={"use": use if t.name == own else None}) for t in result.summary.trackers]
    shown = picture(result.updated(trackers=trackers)).replay.shown  # type: ignore[union-attr]
    assert shown == ((best, last) if use == "published" else (best, own, last))


def test_the_ellipse_of_a_radar_is_long_across_the_line_of_sight(scene: ReplayScene) -> None:
    radar, lidar = scene.measurements
    assert radar.covariance is not None
    assert lidar.covariance is not None
    away = radar.position - np.stack([21 * radar.time, np.full(len(radar.time), 4.0)])
    unit = away / np.hypot(*away)
    across = np.stack([-unit[1], unit[0]])
    along_m, across_m = (np.sqrt(np.einsum("in,ijn,jn->n", u, radar.covariance, u)) for u in (unit, across))
    np.testing.assert_allclose(along_m, 0.3)
    np.testing.assert_allclose(across_m, np.deg2rad(0.5) * np.hypot(*away))
    np.testing.assert_allclose(lidar.covariance, 0.15**2 * np.eye(2)[:, :, None] * np.ones(len(lidar.time)), atol=1e-12)


def test_a_long_run_is_thinned_and_keeps_its_worst_moment(scene: ReplayScene, worst: EstimateMoment) -> None:
    whole, _ = packed_replay(scene)
    assert len(whole) < LIMIT
    text, every = packed_replay(scene, len(whole) // 4)
    assert every > 3
    assert len(text) <= len(whole) // 4
    content = unpacked(text)
    for path in content["paths"]:
        assert len(path["time"]) <= 401 // every + 2
        assert np.abs(path["time"] - worst.time_s).min() < TIME
    assert content["start"] == {"time_s": worst.time_s, "path": worst.object}


# Of a canvas: what its pixel at a place in metres has, and the place of what is nearest to a colour.
HELPERS = """
const replay = page.querySelector('.replay'), [above, line] = replay.querySelectorAll('canvas');
for (let i = 0; i < 50 && !replay.dataset.time; i++) await sleep(20);
const press = (key, options = {}) =>
  replay.dispatchEvent(new KeyboardEvent('keydown', {key, bubbles: true, cancelable: true, ...options}));
const pixel = (x, y) => {
  const [viewX, viewY, scale] = replay.dataset.view.split(' ').map(Number), sharp = above.width / above.clientWidth;
  const at = [above.clientWidth / 2 + (x - viewX) * scale, above.clientHeight / 2 - (y - viewY) * scale];
  return [...above.getContext('2d').getImageData(Math.round(at[0] * sharp), Math.round(at[1] * sharp), 1, 1).data];
};
const state = () => ({...replay.dataset});
"""


def seen(tmp_path: Path, text: str, script: str, width: int = 1280) -> Any:
    value, console = drive(tmp_path, text, HELPERS + script, width)
    # Chromium advises those who read pixels.
    assert [message for message in console if "getImageData" not in message] == []
    return value


def test_numbers_of_a_tracker_that_diverged_stay_finite() -> None:
    wild = series(np.array([1.0, 1e300, -1e18, 2.0]), POSITION)
    counts = np.cumsum(wild["differences"]) if wild["order"] == 1 else np.cumsum(np.cumsum(wild["differences"]))
    assert counts[[0, 3]].tolist() == [100, 200]
    assert counts[1] > 1e10


#: Beside the middle of a vehicle of 5 by 2 m, along and across its heading, m: points of its front away
#: from the edge of a lane under it, and points outside.
FRONT, OUTSIDE = [(2.0, 0.5), (2.2, 0.7), (2.2, -0.7)], [(2.2, 1.4), (2.2, -1.4), (3.0, 0.7)]


@pytest.mark.browser
@pytest.mark.parametrize("width", [390, 1280])
def test_it_opens_at_the_worst_moment_with_the_box_where_the_truth_is(
    tmp_path: Path, document: Document, result: Result, worst: EstimateMoment, width: int
) -> None:
    (truth,) = (rows for (name,), rows in split(result.tables.truth, "object").items() if name == worst.object)
    step = int(np.argmin(abs(truth["time_s"] - worst.time_s)))
    x, y, heading = (float(truth[name][step]) for name in ("px_m", "py_m", "heading_rad"))
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    points = [[x, y] + turn @ place for place in (*FRONT, *OUTSIDE)]
    told = seen(
        tmp_path,
        to_html(document),
        f"""
        const opened = state(), estimate = pixel({worst.px_m}, {worst.py_m});
        replay.querySelectorAll('input').forEach(box => box.checked = false);
        page.dispatchEvent(new Event('change'));
        return {{
          opened, estimate, pixels: {json.dumps([[*point] for point in points])}.map(at => pixel(...at)),
          still: page.querySelector('.still').open, wide: page.documentElement.scrollWidth,
        }};
        """,
        width,
    )
    assert float(told["opened"]["time"]) == pytest.approx(worst.time_s)
    assert told["still"] is False
    assert told["wide"] <= width
    colour = next(style.colour for style in document.trackers if style.name == worst.tracker)
    assert told["estimate"] == pytest.approx([*bytes.fromhex(colour[1:]), 255], abs=4)
    for red, green, blue, alpha in told["pixels"][: len(FRONT)]:
        assert [red, green, blue] == pytest.approx([*bytes.fromhex(TRUTH_COLOUR[1:])], abs=6)
        assert alpha > 150
    assert [pixel[3] for pixel in told["pixels"][len(FRONT) :]] == [0] * len(OUTSIDE)


@pytest.mark.browser
def test_it_plays_and_the_keys_and_the_time_line_move_it(
    tmp_path: Path, document: Document, worst: EstimateMoment
) -> None:
    told = seen(
        tmp_path,
        to_html(document),
        """
        const states = {};
        const say = name => states[name] = state();
        press('Home'); say('home');
        press('ArrowRight'); press('ArrowRight'); press('ArrowLeft'); say('next');
        
        // A browser that shows nothing asks for few frames.
        page.defaultView.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 20);
        press(' '); await sleep(1500); say('playing'); press(' '); say('paused');
        await sleep(300); say('later');
        press('End'); say('end');
        press('ArrowLeft', {shiftKey: true}); say('event');
        press('+'); say('closer');
        press('-'); press('-'); say('farther');
        line.setPointerCapture = () => {};
        const at = line.getBoundingClientRect();
        const point = {clientX: at.left + at.width / 2, clientY: at.top + 60, bubbles: true};
        line.dispatchEvent(new PointerEvent('pointerdown', point)); say('middle');
        replay.querySelector('[name=worst]').click(); say('worst');
        page.defaultView.dispatchEvent(new Event('beforeprint'));
        states.worst.printed = replay.classList.contains('paper');
        return states;
        """,
    )
    time = {name: float(state["time"]) for name, state in told.items()}
    scale = {name: float(state["view"].split()[2]) for name, state in told.items()}
    playing = [name for name, state in told.items() if state["playing"] == "true"]
    assert (time["home"], time["next"], time["end"]) == (0.0, 0.05, 20.0)
    assert 1.0 < time["playing"] < 2.0
    assert playing == ["playing"]
    assert time["paused"] == pytest.approx(round(time["paused"] / 0.05) * 0.05)
    assert time["later"] == time["paused"]
    assert 0 < time["event"] < 20
    assert scale["closer"] == pytest.approx(1.25 * scale["event"])
    assert scale["farther"] == pytest.approx(0.8 * scale["event"])
    assert time["middle"] == pytest.approx(10, abs=0.5)
    assert time["worst"] == pytest.approx(worst.time_s)
    assert told["worst"]["printed"]


def test_the_still_picture_is_there_without_scripts(document: Document) -> None:
    text = to_html(document)
    player = text.index('<div class="replay" hidden')
    still = text.index('<details class="still" open>')
    assert player < still < text.index("<svg viewBox", still)
    assert text.count("sha256-") == text.count("<script>") == 2
