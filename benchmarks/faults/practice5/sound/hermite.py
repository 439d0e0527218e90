"""Three points of Gauss and Hermite along each of the four axes: 81 points, and the update is from their moments."""

from itertools import product

import numpy as np
from benchmarks.faults.parts import Filter, difference, expected

LINE = np.array([-np.sqrt(3.0), 0.0, np.sqrt(3.0)])
SHARE = np.array([1.0, 4.0, 1.0]) / 6.0
UNIT = np.array(list(product(LINE, repeat=4)))
WEIGHT = np.array([np.prod(combination) for combination in product(SHARE, repeat=4)])


class Tracker(Filter):
    def corrected(self, x, P, scan):
        values, axes = np.linalg.eigh(P)
        steps = UNIT @ (axes * np.sqrt(np.maximum(values, 0.0))).T
        centre = expected(x, scan)[0]
        gaps = np.array([difference(expected(x + step, scan)[0], centre, scan) for step in steps])
        middle = WEIGHT @ gaps
        gaps = gaps - middle
        S = (gaps * WEIGHT[:, None]).T @ gaps + scan.noise_covariance
        K = (steps * WEIGHT[:, None]).T @ gaps @ np.linalg.inv(S)
        x = x + K @ (difference(scan.measurement, centre, scan) - middle)
        P = P - K @ S @ K.T
        return x, (P + P.T) / 2
