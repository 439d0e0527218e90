"""Units in a sentence are typeset."""

from __future__ import annotations

import pytest

from trackbench.document import typeset


@pytest.mark.parametrize(
    ("plain", "expected"),
    [
        ("2.6 m/s^2 and 3 m/s3 for 5 s", "2.6~m/s² and 3~m/s³ for 5~s"),
        ("95 % of 3 scenes, 4 deg", "95~% of 3 scenes, 4~deg"),
        ("cost, m^2; m/s^2.5; 60 km/h", "cost, m²; m/s^2.5; 60~km/h"),
    ],
)
def test_units(plain: str, expected: str) -> None:
    assert typeset(plain).replace("\N{NO-BREAK SPACE}", "~") == expected
