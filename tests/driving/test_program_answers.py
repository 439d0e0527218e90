"""Damaged answers of programs: each is refused in one clear line, or is an answer of the right form."""

from __future__ import annotations

import random
from collections import Counter

import msgpack
import numpy as np

from trackbench.base.types import Scan
from trackbench.driving.frames import NotAFrame, frame_message, message_answer, packed_array
from trackbench.driving.steppers import plain_estimate
from trackbench.trackers.answers import TrackerFault, checked_estimate, checked_tracks

ONE = Scan(0.0, "roof", "lidar", np.ones(2), np.array(True), np.eye(2), np.zeros(3), np.zeros(2), 0.0)
THREE = ONE._replace(measurement=np.ones((2, 3)), valid=np.ones(3, dtype=bool))
SEVERAL = ONE._replace(measurement=np.ones((2, 3)), valid=np.ones(3, dtype=bool))
PLAIN = {"type": "estimate", "id": 1, "mean": packed_array(np.arange(4)), "covariance": packed_array(np.eye(4))}
MORE = PLAIN | {"innovation": packed_array(np.ones(2)), "innovation_covariance": packed_array(np.eye(2))}
TRACKS = {
    "type": "tracks",
    "id": 1,
    "ids": packed_array([0, 1]),
    "mean": packed_array(np.ones((4, 2))),
    "covariance": packed_array(np.eye(4)[:, :, None] * np.ones(2)),
    "used": packed_array([0, 1]),
}
BATCH = {
    "type": "estimate",
    "id": 1,
    "mean": packed_array(np.ones((4, 3))),
    "covariance": packed_array(np.eye(4)[:, :, None] * np.ones(3)),
}
WHOLE = (PLAIN, MORE, TRACKS, BATCH)


def outcome(content: bytes, batched: bool) -> str:
    try:
        message = frame_message(content)
        if message.get("type") not in ("estimate", "tracks", "none"):
            return "refused"
        several = message["type"] == "tracks"
        answer = message_answer(message, several)
        if not several and not batched and plain_estimate([answer], ()):
            return "accepted"
        if several:
            checked_tracks(answer, SEVERAL)
        else:
            checked_estimate(answer, THREE if batched else ONE)
    except (NotAFrame, TrackerFault) as refused:
        return "refused" if str(refused) and "\n" not in str(refused) else "not in one line"
    return "accepted"


def test_three_thousand_damaged_answers() -> None:
    draw, whole = random.Random(0), [msgpack.packb(message) for message in WHOLE]
    assert [outcome(content, number > 2) for number, content in enumerate(whole)] == ["accepted"] * 4
    outcomes: Counter[str] = Counter()
    for number in range(3000):
        content = bytearray(whole[number % 4])
        for _ in range(draw.randint(1, 4)):
            damage = [0, 0x7F, 0x91, 0xC0, 0xC1, 0xDD, 0xDF, 0xFF, draw.randrange(256)]
            content[draw.randrange(len(content))] = draw.choice(damage)
        if draw.random() < 0.05:
            content = bytearray(b"\x81\xa1a" + b"\x91" * draw.randint(10, 5000) + b"\xc0")
        with np.errstate(all="ignore"):
            cut = draw.choice([None, draw.randrange(1, len(content))])
            outcomes[outcome(bytes(content[:cut]), number % 4 > 2)] += 1
    assert outcomes["refused"] > 1500
    assert set(outcomes) == {"refused", "accepted"}
