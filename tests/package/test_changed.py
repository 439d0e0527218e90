"""The tests that ``make quick`` runs."""

from __future__ import annotations

from pathlib import Path

from tests.support.changed import selected_tests


def test_the_test_of_a_module_has_its_name_or_imports_it(tmp_path: Path) -> None:
    for name, text in {
        "tests/base/test_angles.py": "",
        "tests/base/test_turns.py": "from trackbench.base.turning import turn",
        "tests/base/test_other.py": "from trackbench.base.angles import wrap",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    source = Path("src/trackbench/base")
    assert selected_tests([source / "angles.py"], tmp_path) == ["tests/base/test_angles.py"]
    assert selected_tests([source / "turning.py"], tmp_path) == ["tests/base/test_turns.py"]
    assert len(selected_tests([source / "alone.py"], tmp_path)) == 3
    changed = [Path("tests/base/test_other.py"), Path("tests/base/test_gone.py"), Path("docs/index.md")]
    assert selected_tests(changed, tmp_path) == ["tests/base/test_other.py"]
