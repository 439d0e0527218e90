"""Where a log's sensors lie on a map."""

import json
from itertools import product
from pathlib import Path

import pytest
from tests.support.claims import claim_of, envelope_of
from tests.support.recorded_log import Errors, write_log

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.document.markdown import to_markdown
from trackbench.subjects.envelope.audited_log import AuditedLog, audited_log, surrounding
from trackbench.subjects.envelope.axes import axes_of
from trackbench.subjects.envelope.config import EnvelopeConfig
from trackbench.subjects.envelope.report import envelope_document

SENSORS = {
    "radar": {
        "type": "radar",
        "rate_hz": 20,
        "range_sigma_m": 0.3,
        "azimuth_sigma_deg": 0.5,
        "range_rate_sigma_mps": 0.1,
    },
    "lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.15},
}
AUDIT = {
    "scenario": "my log",
    "sensors": {
        "radar": {
            "rate_hz": 18.5,
            "detections": {"value": 0.87},
            "components": {
                "range": {"sigma": {"value": 0.4}},
                "azimuth": {"sigma": {"value": 0.0174532925}},
                "range_rate": {"sigma": {"value": None}},
            },
        },
        "lidar": {
            "rate_hz": None,
            "detections": {"value": None},
            "components": {"x": {"sigma": {"value": 0.3}}, "y": {"sigma": {"value": 0.4}}},
        },
    },
}


def loaded():
    truth = {
        "source": "scripted",
        "duration_s": 3,
        "rate_hz": 20,
        "objects": {"car": {"start": {"x": 20, "y": 5, "speed_mps": 10}}},
    }
    tracker = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 1}
    return tb.load({"name": "map", "truth": truth, "sensors": SENSORS, "trackers": {"ekf": tracker}})


def axes(**ways):
    return axes_of(EnvelopeConfig.model_validate({"axes": ways}))


def written(tmp_path: Path, content=AUDIT) -> Path:
    (tmp_path / "audit.json").write_text(json.dumps(content))
    return tmp_path


@pytest.mark.parametrize(
    ("axis", "value"),
    [
        ({"key": "sensors.radar.azimuth_sigma_deg", "from": 0.1, "to": 3}, 1.0),
        ({"key": "sensors.radar.range_sigma_m", "from": 0.1, "to": 3}, 0.4),
        # sqrt((.3^2 + .4^2) / 2)
        ({"key": "sensors.lidar.position_sigma_m", "values": [0.1, 0.5]}, 0.125**0.5),
        ({"key": "sensors.radar.detection_probability", "from": 0.5, "to": 1}, 0.87),
        ({"key": "sensors.radar.rate_hz", "values": [10, 20]}, 18.5),
        ({"keys": {"sensors.radar.range_sigma_m": {"factor": 0.2}, "truth.rate_hz": {}}, "from": 1, "to": 5}, 2.0),
    ],
)
def test_an_axis_has_what_the_audit_found_in_its_unit(tmp_path, axis, value):
    found = audited_log(written(tmp_path), loaded(), axes(a=axis))
    assert found.name == "my log"
    assert found.values == {"a": pytest.approx(value)}


def test_a_real_audit_gives_the_noise_that_the_log_has(tmp_path):
    path = write_log(tmp_path, radar=Errors())
    tb.audit(path).save(tmp_path / "audit")
    scenario = tb.load(path)
    name, config = next((n, c) for n, c in scenario.config.sensors.items() if c.type == "radar")
    found = audited_log(
        tmp_path / "audit", scenario, axes(a={"key": f"sensors.{name}.range_sigma_m", "from": 0.01, "to": 3})
    )
    assert found.values["a"] == pytest.approx(config.range_sigma_m, rel=0.15)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (AUDIT, "the audit says nothing of any axis: it has sensors.radar.range_sigma_m"),
        ({**AUDIT, "sensors": {"camera": {}}}, "it has nothing of the scenario's sensors; the axes vary truth.rate_hz"),
        ({"sensors": {"radar": 3}}, "not a readable audit.json"),
        ([], "not a readable audit.json"),
    ],
)
def test_what_says_nothing_is_refused(tmp_path, content, says):
    with pytest.raises(InputError, match=says):
        audited_log(written(tmp_path, content), loaded(), axes(a={"key": "truth.rate_hz", "from": 5, "to": 20}))


def test_no_audit_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"there is no audit\.json"):
        audited_log(tmp_path, loaded(), axes(a={"key": "truth.rate_hz", "from": 5, "to": 20}))


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"q": 1.1}, "are inside the envelope of ekf: it holds in the 2 cells around"),
        ({"q": 2.9}, "are outside the envelope of ekf: it fails in the 2 cells around"),
        # Nearer to 1.5, which holds, than to 2.
        ({"q": 1.6}, "are not decided for ekf: of the 2 cells around 1 holds, 0 fails, 1 undecided"),
        ({"q": 1.1}, "only the axes were compared"),
        ({"q": 0.5}, "lie outside the map: q 0.5 m is below 1 m"),
    ],
)
def test_the_page_says_whether_the_log_is_inside(values, says):
    ways = {
        "q": {"key": "sensors.radar.range_sigma_m", "from": 1.0, "to": 3.0, "levels": 5},
        "r": {"key": "sensors.radar.azimuth_sigma_deg", "from": 0.1, "to": 10.0, "levels": 3, "scale": "log"},
    }
    claim = claim_of(ways, {"ekf": lambda x, y: 0.5 + x}).model_copy(
        update={"log": AuditedLog(name="my log", values=values)}
    )
    document = envelope_document(envelope_of(claim))
    assert says in to_markdown(document).replace("\n", " ").replace("\\", "")
    labels = {entry.label for figure in document.figures for entry in figure.legend}
    assert ("sensors of my log" in labels) == (values["q"] >= 1)


def test_the_points_around_are_the_corners_that_were_tried():
    ways = axes(
        q={"key": "sensors.radar.range_sigma_m", "from": 0, "to": 4, "levels": 3},
        n={"key": "sensors.radar.rate_hz", "values": [5, 10, 20]},
        kind={"key": "truth.world", "choices": ["ideal", "human"]},
    )
    grid = [*product(*(axis.values for axis in ways))]
    own = {"q": 1.5, "n": 7, "kind": "human"}
    corners = [(q, n, "human") for q in (0, 2) for n in (5, 10)]
    assert surrounding(own, ways, grid) == corners
    assert len(surrounding({**own, "kind": None}, ways, grid)) == 8
    assert surrounding({**own, "n": 10.0}, ways, grid) == [(0, 10, "human"), (2, 10, "human")]
    # A value of some corners does not split the box, but is in it; a value of all of them does.
    assert surrounding(own, ways, [*grid, (1, 5, "human")]) == [*corners, (1, 5, "human")]
    split = [(1, 5, "human"), (1, 10, "human")]
    assert set(surrounding(own, ways, [*grid, *split])) == {*split, *(c for c in corners if c[0] == 2)}
    # Beyond the map, and where a corner was not tried, nothing is around.
    assert surrounding({**own, "n": 30}, ways, grid) == []
    assert surrounding(own, ways, [point for point in grid if point != corners[0]]) == []


def test_an_audit_that_says_nothing_leaves_nothing(cli, tmp_path):
    axes = {"speed": {"key": "truth.objects.car.start.speed_mps", "from": 5, "to": 20}}
    (tmp_path / "map.yaml").write_text(
        json.dumps(
            {
                **loaded().document.value,
                "expect": [{"tracker": "ekf", "metric": "position_rmse", "below": 1}],
                "envelope": {"axes": axes},
            }
        )
    )
    done = cli("envelope", "map.yaml", "--log", written(tmp_path), "--out", "out")
    assert done.status == 2
    assert "the audit says nothing of any axis" in done.err
    assert not list((tmp_path / "out").glob("*"))
