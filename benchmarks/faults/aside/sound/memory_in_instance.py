"""All memory is in the instance; the state is only the number of scans."""

from benchmarks.faults.parts import Filter


class Tracker(Filter):
    def __init__(self):
        self.memory = None

    def step(self, state, scan):
        self.memory, (x, P) = super().step(None if state is None else self.memory, scan)
        return (state or 0) + 1, (x.copy(), P.copy())
