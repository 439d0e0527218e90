"""All tracks are rows of one record array and updated together, in information form; pairs by the Hungarian method."""

import numpy as np
from benchmarks.faults import parts
from scipy.optimize import linear_sum_assignment

RECORD = np.dtype([("y", "f8", 4), ("Y", "f8", (4, 4)), ("seen", "f8"), ("hits", "i4"), ("missed", "i4"), ("id", "i4")])
LIMIT = {2: 18.4, 3: 21.1}


def moments(table):
    P = np.linalg.inv(table["Y"])
    P = (P + P.transpose(0, 2, 1)) / 2
    return np.einsum("nij,nj->ni", P, table["y"]), P


class Tracker:
    identities = "hidden"

    def step(self, state, scan):
        if state is None:
            time, count, table = scan.time, 0, np.zeros(0, RECORD)
        else:
            time, count, table = state[0], state[1], state[2].copy()
        self.predict(table, scan.time - time)
        found = [parts.linear(scan, column) for column in scan.measurement.T]
        rows, columns = self.pairs(table, found)
        for i, j in zip(rows, columns, strict=True):
            z, H, R = found[j]
            W = np.linalg.inv(R + 1e-9 * np.eye(len(z)))
            table["y"][i] += H.T @ W @ z
            table["Y"][i] += H.T @ W @ H
        table["hits"][rows] += 1
        table["seen"][rows] = scan.time
        table["missed"][rows] = 0
        visible = np.array([parts.in_view(x, scan) for x in moments(table)[0]], bool)
        visible[rows] = False
        table["missed"][visible] += 1
        for i in np.flatnonzero((table["id"] < 0) & (table["hits"] >= 3)):
            table["id"][i], count = count, count + 1
        known = table["id"] >= 0
        recent = scan.time - table["seen"] <= 1.0
        table = table[recent & (known | (table["missed"] < 2))]
        new = self.begun([d for j, d in enumerate(found) if j not in columns], scan.time)
        table = np.concatenate([table, new])
        return (scan.time, count, table), self.shown(table)

    def predict(self, table, dt):
        if len(table) and dt > 0:
            x, P = moments(table)
            F, Q = parts.constant_velocity(dt)
            Y = np.linalg.inv(F @ P @ F.T + Q)
            table["Y"] = (Y + Y.transpose(0, 2, 1)) / 2
            table["y"] = np.einsum("nij,nj->ni", table["Y"], x @ F.T)

    def pairs(self, table, found):
        if not len(table) or not found:
            return [], []
        x, P = moments(table)
        cost = np.full((len(table), len(found)), 1e4)
        for j, (z, H, R) in enumerate(found):
            nu, S = z - x @ H.T, H @ P @ H.T + R
            d2 = np.einsum("ni,ni->n", nu, np.linalg.solve(S, nu[..., None])[..., 0])
            near = d2 < LIMIT[len(z)]
            cost[near, j] = (d2 + np.linalg.slogdet(S)[1])[near]
        rows, columns = linear_sum_assignment(cost)
        good = cost[rows, columns] < 1e4
        return rows[good].tolist(), columns[good].tolist()

    def begun(self, found, time):
        new = np.zeros(len(found), RECORD)
        for k, (z, H, R) in enumerate(found):
            W = np.linalg.inv(R + 1e-9 * np.eye(len(z)))
            new["Y"][k] = H.T @ W @ H + np.diag([1e-8, 1e-8, 1 / 625, 1 / 625])
            new["y"][k] = H.T @ W @ z
        new["seen"], new["hits"], new["id"] = time, 1, -1
        return new

    def shown(self, table):
        table = table[table["id"] >= 0]
        if not len(table):
            return None
        x, P = moments(table)
        return table["id"].astype(int), x.T.copy(), np.moveaxis(P, 0, 2).copy()
