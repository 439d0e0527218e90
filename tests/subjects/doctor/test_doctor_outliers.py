"""Gates that stay shut, and wildly wrong measurements."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from benchmarks.faults.bases.imm_noises import Tracker as Imm
from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
from tests.support.doctor import Part, under_test

from trackbench.subjects.doctor.checks.outliers import gate, outliers


class Gated(PlainEkf):
    """Rejects a measurement beyond the 99.9 % gate of its innovation covariance, as if it were missed."""

    limit = 16.3

    def distance(self, x: Any, P: Any, scan: Any) -> float:
        y, H = self.innovation(scan, self.predicted_measurement(x, scan)), self.sensor_jacobian(x, scan)
        return float(y @ np.linalg.solve(self.spread(H, P, scan), y))

    def spread(self, H: Any, P: Any, scan: Any) -> Any:
        return H @ P @ H.T + self.noise(scan)

    def update(self, x: Any, P: Any, scan: Any) -> Any:
        return super().update(x, P, scan) if self.distance(x, P, scan) < self.limit else (x, P)


class Shut(Gated):
    """Keeps the covariance of before where a measurement is rejected."""

    def advance(self, track: Any, scan: Any) -> Any:
        after = super().advance(track, scan)
        x, P = self.predict(track.mean, track.covariance, scan.time - track.time)
        rejected = scan.valid and self.distance(x, P, scan) >= self.limit
        return after._replace(covariance=track.covariance) if rejected else after


class Weighed(PlainEkf):
    """Weighs its innovation by a likelihood over its sum with that of no other model: 0 / 0 far off."""

    def corrected_mean(self, x: Any, K: Any, y: Any) -> Any:
        likelihood = np.exp(-0.5 * y @ y)
        with np.errstate(invalid="ignore"):
            return x + K @ y * (likelihood / likelihood)


class Underflowing(Imm):
    """Its likelihoods are 0 far off, and its probabilities 0 / 0."""

    def update(self, scan: Any) -> Any:
        before = self.mu
        super().update(scan)
        likelihoods = [0.0 if model.likelihood == 1e-300 else model.likelihood for model in self.models]
        with np.errstate(invalid="ignore"):
            self.mu = before * likelihoods / np.sum(before * likelihoods)


class Distrustful(PlainEkf):
    """Believes no measurement any more after a large innovation."""

    factor = 1.0

    def noise(self, scan: Any) -> Any:
        return self.factor * super().noise(scan)

    def corrected_mean(self, x: Any, K: Any, y: Any) -> Any:
        self.factor = 1e6 if self.factor > 1.0 or np.abs(y).max() > 20.0 else 1.0
        return x + K @ y


@pytest.mark.parametrize(
    ("check", "tracker", "fault"),
    [
        (gate, Shut, "gate_never_reopens"),
        (outliers, Weighed, "nonfinite"),
        (outliers, Underflowing, "imm_likelihood_underflow"),
        (outliers, Distrustful, "lost_after_outlier"),
    ],
)
def test_a_fault_is_named(check: Part, tracker: type[PlainEkf], fault: str) -> None:
    assert {finding.fault for finding in check(under_test(tracker)).findings} == {fault}


@pytest.mark.parametrize("check", [gate, outliers])
@pytest.mark.parametrize("tracker", [PlainEkf, Gated])
def test_a_sound_gate_and_none_have_no_finding(check: Part, tracker: type[PlainEkf]) -> None:
    result = check(under_test(tracker))
    assert [one.passed for one in result.checks] == [True]
