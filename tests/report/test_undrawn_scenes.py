"""What a comparison over scenes says of scenes that were not drawn."""

from __future__ import annotations

from trackbench.report.scenes import undrawn_scenes


def test_how_frequent_and_how_different_a_kind_of_scene_may_be_is_said() -> None:
    (of_40,), (of_10,) = undrawn_scenes(40), undrawn_scenes(10)
    # 0.05^(1/40) = 0.9278, and 0.9278 / 0.0722 = 12.8.
    assert "7.2 % of all" in of_40
    assert "13 times" in of_40
    assert "26 % of all" in of_10
    assert "2.9 times" in of_10


def test_where_few_scenes_decide_it_is_said_how_many_are_needed() -> None:
    (of_40,) = undrawn_scenes(40, few_decide=True)
    assert "fewer than 500 scenes" in of_40
    assert undrawn_scenes(500, few_decide=True) == undrawn_scenes(500)


def test_nothing_is_said_where_there_is_no_verdict() -> None:
    assert undrawn_scenes(0) == undrawn_scenes(4) == []
