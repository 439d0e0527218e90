"""A Kalman filter that gives out twice its covariance, for those who plan with it; inside it uses its own."""

from benchmarks.faults.parts import Filter


class Tracker(Filter):
    def __init__(self, margin=2.0):
        self.margin = margin

    def output(self, x, P):
        return x, self.margin * P
