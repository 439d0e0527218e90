"""A thesis' MATLAB in Python: integrated PDA with structures, where tracks count as clutter for each other."""

from types import SimpleNamespace as struct

import numpy as np

prm = struct(
    Ps=0.98,  # survival, per second
    Pg=0.9997,
    gate={2: 16.2, 3: 18.8},
    r0=0.15,
    r_conf=0.95,
    r_del=0.01,
    n_conf=3,
    q=3.0,
    vmax=20.0,
)


def f_predict(trk, T):
    A = np.array([[1, 0, T, 0], [0, 1, 0, T], [0, 0, 1, 0], [0, 0, 0, 1]])
    a, b, c = prm.q * T**3 / 3, prm.q * T**2 / 2, prm.q * T
    Q = np.array([[a, 0, b, 0], [0, a, 0, b], [b, 0, c, 0], [0, b, 0, c]])
    trk.x = A @ trk.x
    trk.P = A @ trk.P @ A.T + Q
    trk.r = trk.r * prm.Ps**T


def f_convert(scan):
    """Measurements in the plane: z, H, square root of R, density of false alarms."""
    x0, y0, psi = scan.sensor_pose
    meas = []
    for m in scan.measurement.T:
        if scan.kind == "radar":
            rho, th = m[0], psi + m[1]
            c, s = np.cos(th), np.sin(th)
            J = np.array([[c, -rho * s, 0], [s, rho * c, 0], [0, 0, 1]])
            z = np.array([x0 + rho * c, y0 + rho * s, m[2] + np.dot([c, s], scan.sensor_velocity)])
            H = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s]])
            R = J @ scan.noise_covariance @ J.T + np.diag([0, 0, 0.15**2])
            lam = scan.clutter_density / max(rho, 1.0)
        else:
            J = np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])
            z, H = np.array([x0, y0]) + J @ m, np.eye(2, 4)
            R = J @ scan.noise_covariance @ J.T
            lam = scan.clutter_density
        meas.append(struct(z=z, H=H, SR=np.linalg.cholesky(R), lam=lam + 1e-9))
    return meas


def f_likelihoods(trks, meas):
    """Of each measurement for each track, zero outside of the gate; also the innovations and their covariances."""
    g = np.zeros((len(trks), len(meas)))
    nu = [[None] * len(meas) for _ in trks]
    S = [[None] * len(meas) for _ in trks]
    for i, trk in enumerate(trks):
        for j, m in enumerate(meas):
            nu[i][j] = m.z - m.H @ trk.x
            S[i][j] = m.H @ trk.P @ m.H.T + m.SR @ m.SR.T
            d2 = nu[i][j] @ np.linalg.solve(S[i][j], nu[i][j])
            if d2 < prm.gate[len(m.z)]:
                g[i, j] = np.exp(-d2 / 2) / np.sqrt(np.linalg.det(2 * np.pi * S[i][j]))
    return g, nu, S


def f_visible(trk, scan):
    return np.hypot(*(trk.x[:2] - scan.sensor_pose[:2])) < scan.field_of_view.max_range


def f_update(trk, pd, g, lam, nu, S, meas):
    L = pd * g / lam
    delta = pd * prm.Pg - np.sum(L)
    beta0 = (1 - pd * prm.Pg) / (1 - delta)
    beta = L / (1 - delta)
    trk.r = (1 - delta) * trk.r / (1 - delta * trk.r)
    xj, Pj, wj = [trk.x], [trk.P], [beta0]
    for j in np.flatnonzero(beta > 0):
        H = meas[j].H
        W = trk.P @ H.T @ np.linalg.inv(S[j])
        xj.append(trk.x + W @ nu[j])
        Pj.append(trk.P - W @ S[j] @ W.T)
        wj.append(beta[j])
    x = np.zeros(4)
    for k in range(len(wj)):
        x = x + wj[k] * xj[k]
    P = np.zeros((4, 4))
    for k in range(len(wj)):
        d = xj[k] - x
        P = P + wj[k] * (Pj[k] + np.outer(d, d))
    trk.x = x
    trk.P = (P + P.T) / 2
    if beta0 < 0.5:
        trk.n += 1


def f_birth(m):
    R = m.SR @ m.SR.T
    P = np.diag([0.0, 0.0, prm.vmax**2, prm.vmax**2])
    P[:2, :2] = R[:2, :2]
    return struct(x=np.concatenate([m.z[:2], [0.0, 0.0]]), P=P, r=prm.r0, n=1, id=-1)


def f_merge(trks):
    """Without the younger one of two that have become the same."""
    out = []
    for trk in sorted(trks, key=lambda t: (t.id < 0, t.id)):
        same = False
        for o in out:
            d = trk.x - o.x
            same = same or (np.hypot(d[0], d[1]) < 1.0 and np.hypot(d[2], d[3]) < 3.0)
        if not same:
            out.append(trk)
    return out


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.trks = []
        self.t = None
        self.next_id = 0

    def step(self, state, scan):
        T = 0.0 if self.t is None else scan.time - self.t
        self.t = scan.time
        for trk in self.trks:
            f_predict(trk, T)
        meas = f_convert(scan)
        g, nu, S = f_likelihoods(self.trks, meas)
        pd = np.array([scan.detection_probability if f_visible(trk, scan) else 1e-3 for trk in self.trks])
        r = np.array([trk.r for trk in self.trks])
        own = (pd * r)[:, None] * g if len(self.trks) else np.zeros((0, len(meas)))
        lam = np.array([m.lam for m in meas])
        claimed = own.sum(axis=0)
        for i, trk in enumerate(self.trks):
            f_update(trk, pd[i], g[i], lam + claimed - own[i], nu[i], S[i], meas)
            if trk.id < 0 and trk.r > prm.r_conf and trk.n >= prm.n_conf:
                trk.id = self.next_id
                self.next_id += 1
        self.trks = f_merge([trk for trk in self.trks if trk.r > prm.r_del])
        for j, m in enumerate(meas):
            if claimed[j] < lam[j]:
                self.trks.append(f_birth(m))
        return None, self.f_output()

    def f_output(self):
        out = [trk for trk in self.trks if trk.id >= 0 and trk.r > 0.3]
        if not out:
            return None
        return np.array([t.id for t in out]), np.array([t.x for t in out]).T, np.stack([t.P for t in out], axis=-1)
