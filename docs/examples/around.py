import copy

from my_filter import MyFilter

from trackbench.models.sensors import SENSOR_MODELS


class Around:
    def step(self, state, scan):
        z, R = SENSOR_MODELS[scan.kind].position(scan)[:2]  # the position that is measured, in the fixed frame
        if state is None:
            return (scan.time, MyFilter(z, R)), None
        time, own = state
        own = copy.deepcopy(own)  # the state that was given stays as it is
        own.predict(scan.time - time)
        if scan.valid:
            own.update(z, R)
        return (scan.time, own), (own.x, own.P)
