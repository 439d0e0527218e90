"""A small library of the browser, carried over: nested lists, and a configuration of functions of options."""

import math


def matMul(a, b):
    return [[sum(x * y for x, y in zip(row, column, strict=True)) for column in zip(*b, strict=True)] for row in a]


def transpose(a):
    return [list(row) for row in zip(*a, strict=True)]


def add(a, b):
    return [[x + y for x, y in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def sub(a, b):
    return [[x - y for x, y in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def identity(n):
    return [[1.0 if i == j else 0.0 for j in range(n)] for i in range(n)]


def invert(a):
    n = len(a)
    rows = [list(row) + unit for row, unit in zip(a, identity(n), strict=True)]
    for i in range(n):
        pivot = max(range(i, n), key=lambda k: abs(rows[k][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for k in range(n):
            if k != i:
                rows[k] = [x - rows[k][i] * y for x, y in zip(rows[k], rows[i], strict=True)]
    return [row[n:] for row in rows]


def constantSpeed(acceleration=3.0):
    """The part of a configuration that says how the state moves."""

    def transition(options):
        dt = options["timeStep"]
        return [[1.0, 0.0, dt, 0.0], [0.0, 1.0, 0.0, dt], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]

    def covariance(options):
        dt = options["timeStep"]
        column = [dt**2 / 2, dt]
        q = [[acceleration**2 * a * b for b in column] for a in column]
        return [[q[i // 2][j // 2] if i % 2 == j % 2 else 0.0 for j in range(4)] for i in range(4)]

    return {"dimension": 4, "transition": transition, "covariance": covariance}


class KalmanFilter:
    def __init__(self, dynamic, observation):
        self.dynamic, self.observation = dynamic, observation

    def predict(self, previousCorrected, options):
        d = self.dynamic["transition"](options)
        mean = matMul(d, previousCorrected["mean"])
        moved = matMul(matMul(d, previousCorrected["covariance"]), transpose(d))
        return {"mean": mean, "covariance": add(moved, self.dynamic["covariance"](options))}

    def correct(self, predicted, options):
        h = self.observation["stateProjection"](options)
        r = self.observation["covariance"](options)
        pht = matMul(predicted["covariance"], transpose(h))
        gain = matMul(pht, invert(add(matMul(h, pht), r)))
        innovation = sub(options["observation"], matMul(h, predicted["mean"]))
        rest = sub(identity(self.dynamic["dimension"]), matMul(gain, h))
        covariance = add(
            matMul(matMul(rest, predicted["covariance"]), transpose(rest)),
            matMul(matMul(gain, r), transpose(gain)),
        )
        half = [[0.5 * value for value in row] for row in covariance]
        return {"mean": add(predicted["mean"], matMul(gain, innovation)), "covariance": add(half, transpose(half))}


def pointOf(scan):
    """What a scan says in the map: place, its covariance and, of a radar, the ray and the speed along it."""
    ex, ey, yaw = (float(value) for value in scan.sensor_pose)
    noise = [[float(value) for value in row] for row in scan.noise_covariance]
    z = [float(value) for value in scan.measurement]
    radar = scan.kind == "radar"
    reach, angle = (z[0], yaw + z[1]) if radar else (1.0, yaw)
    c, s = math.cos(angle), math.sin(angle)
    j = [[c, -reach * s], [s, reach * c]]
    local = [[z[0]], [0.0]] if radar else [[z[0]], [z[1]]]
    offset = matMul(j, local)
    point = {
        "place": [[ex + offset[0][0]], [ey + offset[1][0]]],
        "covariance": matMul(matMul(j, [row[:2] for row in noise[:2]]), transpose(j)),
    }
    if radar:
        u, w = (float(value) for value in scan.sensor_velocity)
        vr = z[2]
        vrCompensated = vr + c * u + s * w
        point |= {"ray": [c, s], "speed": vrCompensated, "speedVariance": noise[2][2], "turn": noise[1][1]}
        point["own"] = c * w - s * u
    return point


def stateProjection(options):
    h = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]
    if "ray" in options["point"]:
        h.append([0.0, 0.0, *options["point"]["ray"]])
    return h


def observationCovariance(options):
    """The ray is that of the measured azimuth, with its error."""
    point = options["point"]
    r = [list(row) for row in point["covariance"]]
    if "ray" in point:
        c, s = point["ray"]
        vx, vy = (row[0] for row in options["predicted"]["mean"][2:])
        across = max(-30.0, min(30.0, c * vy - s * vx - point["own"]))
        r = [[*r[0], 0.0], [*r[1], 0.0], [0.0, 0.0, point["speedVariance"] + across**2 * point["turn"]]]
    return r


FILTER = KalmanFilter(
    dynamic=constantSpeed(),
    observation={"stateProjection": stateProjection, "covariance": observationCovariance},
)


class Tracker:
    def step(self, state, scan):
        time = float(scan.time)
        if state is None:
            point = pointOf(scan)
            (a, b), (c, d) = point["covariance"]
            covariance = [[a, b, 0.0, 0.0], [c, d, 0.0, 0.0], [0.0, 0.0, 400.0, 0.0], [0.0, 0.0, 0.0, 400.0]]
            corrected = {"mean": [*point["place"], [0.0], [0.0]], "covariance": covariance}
        else:
            corrected = FILTER.predict(state["corrected"], {"timeStep": time - state["time"]})
            if scan.valid:
                point = pointOf(scan)
                observation = [*point["place"], [point["speed"]]] if "ray" in point else point["place"]
                options = {"point": point, "predicted": corrected, "observation": observation}
                corrected = FILTER.correct(corrected, options)
        mean = [row[0] for row in corrected["mean"]]
        return {"time": time, "corrected": corrected}, (mean, corrected["covariance"])
