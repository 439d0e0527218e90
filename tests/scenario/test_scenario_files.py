"""Files that are not YAML or no scenario, and values set over a file from the command line."""

from pathlib import Path

import pytest
from tests.support.places import DATA

from trackbench.base.errors import InputError
from trackbench.scenario import load_scenario

GOOD = (DATA / "scenario.yaml").read_text(encoding="utf-8")

# What is replaced, by what, and the message after the file's name.
NOT_YAML = [
    (
        "runs: 100",
        "runs: 100, runs: 4",
        "24: runs: this key is given twice, first in line 24; remove one",
    ),
    ("description: one line", "\tdescription: tab", "2: a tab where YAML needs spaces"),
    (
        "description: one line",
        "description: merge: and exit",
        "2: not valid YAML: a colon is missing in or before this line, or there is a second ': ' in it, or its "
        "indentation is wrong; quote text that contains ': '",
    ),
    (
        "runs: 100",
        "runs: !!python/name:os.system 1",
        "24: monte_carlo.runs: the tag 'tag:yaml.org,2002:python/name:os.system' is not known; remove it",
    ),
    ("seed: 7", "[seed]: 7", "24: a key must be a single word"),
    ("seed: 7", "<<: *nothing", "24: not valid YAML: found undefined alias 'nothing'"),
    ("score: {settle_s: 2}", "score: &a {reference: *a}", "25: score.reference: an anchor that contains itself"),
    ("name: example", "name: example\n---\nname: b", "2: a second YAML document; a scenario file holds one"),
    ("one line", "one\x07line", "2: a control character, which a scenario cannot hold"),
]


def messages(path: Path, *overrides: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        load_scenario(path, overrides)
    return str(caught.value).replace(str(path), "FILE").splitlines()


@pytest.mark.parametrize(("old", "new", "expected"), NOT_YAML)
def test_not_yaml(tmp_path: Path, old: str, new: str, expected: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(GOOD.replace(old, new, 1), encoding="utf-8")

    assert messages(path) == [f"FILE:{expected}"]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "FILE:1: the file is empty; a scenario has the keys name, truth, trackers"),
        (b"# only a comment\n", "FILE:1: the file is empty; a scenario has the keys name, truth, trackers"),
        (
            b"- a\n- b\n",
            "FILE:1: the file is not a mapping of keys to values; a scenario has the keys name, truth, trackers",
        ),
        (b"name: a\nb: \xff\n", "FILE:2: not UTF-8 text (byte 0xff); save the file as UTF-8"),
        (b"name: [" * 3000, "FILE: nested too deeply"),
    ],
    ids=["empty", "comment", "list", "encoding", "deep"],
)
def test_file_that_is_no_scenario(tmp_path: Path, content: bytes, expected: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_bytes(content)

    [message] = messages(path)
    assert message.endswith(expected)


def test_missing_file_names_its_nearest_neighbour(tmp_path: Path) -> None:
    (tmp_path / "highway.yaml").write_text(GOOD)

    near = f"'{tmp_path}/highway.yaml'?"
    assert messages(tmp_path / "higway.yaml") == [f"FILE: there is no such file; did you mean {near}"]
    (far,) = messages(tmp_path / "no" / "x.yaml")
    assert far.startswith("FILE: there is no such file; `trackbench list scenarios` shows")


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("monte_carlo.runs=0", "--set monte_carlo.runs=0: monte_carlo.runs: 0 is not possible: it must be at least 1"),
        (
            "trackers.ekf.sensors.1=rof",
            "--set trackers.ekf.sensors.1=rof: trackers.ekf.sensors.1: the scenario has no sensor 'rof'; "
            "did you mean 'roof'?",
        ),
        # The override breaks what the file says elsewhere, so the file's line is named.
        (
            "truth.rate_hz=10",
            "FILE:13: sensors.front.rate_hz: 20 Hz does not divide truth.rate_hz, which is 10; use 10",
        ),
        ("monte_carlo.runs", "--set monte_carlo.runs: write --set key.path=value, such as --set monte_carlo.runs=10"),
        ("expect.1.below=2", "--set expect.1.below=2: expect: '1' is not an index of this list; choose from 0 to 0"),
        (
            "trackers.ukf.initial.position_sigma_m=2",
            "--set trackers.ukf.initial.position_sigma_m=2: trackers.ukf.initial: it is 'truth', which has no key "
            "'position_sigma_m'; set it as a whole: --set 'trackers.ukf.initial={...}'",
        ),
        ("name=[", "--set name=[: not valid YAML: expected the node content, but found '<stream end>'"),
    ],
)
def test_override_message(tmp_path: Path, override: str, expected: str) -> None:
    path = tmp_path / "good.yaml"
    path.write_text(GOOD)

    assert messages(path, override) == [expected]


def test_nesting_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "deep.yaml"
    path.write_text("name: deep\n" + "".join(f"{' ' * n}a:\n" for n in range(1500)), encoding="utf-8")
    assert messages(path)[0].endswith(": nested too deeply")
