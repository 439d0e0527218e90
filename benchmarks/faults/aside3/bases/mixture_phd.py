"""A Gaussian mixture PHD in the style of the pseudocode: components, update terms, pruning, extraction by tags."""

import numpy as np

BIRTH = 0.012  # of a birth against clutter
TRUNCATE, MERGE, COMPONENTS = 1e-5, 8.0, 50
LIFE, LIFE_OUTSIDE = 25.0, 0.8  # s
LOWEST = 1e-12
SHOWN_AFTER, SHOWN_FOR = 3, 0.45  # scans, s


class GmphdComponent:
    def __init__(self, weight, loc, cov, tag):
        self.weight, self.loc, self.cov, self.tag = weight, loc, cov, tag


class Observer:
    def __init__(self, scan):
        self.polar = scan.kind == "radar"
        self.origin, self.yaw, self.velocity = scan.sensor_pose[:2], scan.sensor_pose[2], scan.sensor_velocity
        self.r = scan.noise_covariance
        self.reach = scan.field_of_view.max_range
        self.detection = min(scan.detection_probability, 0.98)
        self.clutter = max(scan.clutter_density, 1e-8)

    def covers(self, loc):
        return np.hypot(*(loc[:2] - self.origin)) < self.reach

    def h(self, loc):
        dx, dy = loc[:2] - self.origin
        if not self.polar:
            c, s = np.cos(self.yaw), np.sin(self.yaw)
            turn = np.array([[c, s], [-s, c]])
            return turn @ [dx, dy], np.hstack([turn, np.zeros((2, 2))])
        ux, uy = loc[2:] - self.velocity
        r = max(np.hypot(dx, dy), 0.5)
        c, s = dx / r, dy / r
        across = (c * uy - s * ux) / r
        jacobian = np.array([[c, s, 0, 0], [-s / r, c / r, 0, 0], [-s * across, c * across, c, s]])
        return np.array([r, np.arctan2(dy, dx) - self.yaw, c * ux + s * uy]), jacobian

    def difference(self, z, nu):
        d = z - nu
        if self.polar:
            d[1] = np.mod(d[1] + np.pi, 2 * np.pi) - np.pi
        return d

    def birth(self, z):
        r, a = (z[0], self.yaw + z[1]) if self.polar else (1.0, self.yaw)
        c, s = np.cos(a), np.sin(a)
        jacobian = np.array([[c, -r * s], [s, r * c]])
        place = self.origin + jacobian @ ([r, 0.0] if self.polar else z)
        cov = np.diag([0.0, 0.0, 400.0, 400.0])
        cov[:2, :2] = jacobian @ self.r[:2, :2] @ jacobian.T
        return np.append(place, [0.0, 0.0]), cov


class Gmphd:
    def __init__(self):
        self.gmm = []
        self.tags = 0

    def predict(self, dt, observer):
        f = np.eye(4) + dt * np.eye(4, k=2)
        q = 3.0 * np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2))
        for comp in self.gmm:
            comp.loc, comp.cov = f @ comp.loc, f @ comp.cov @ f.T + q
            comp.weight *= np.exp(-dt / (LIFE if observer.covers(comp.loc) else LIFE_OUTSIDE))

    def update(self, obs, observer):
        pd = [observer.detection if observer.covers(comp.loc) else 0.0 for comp in self.gmm]
        # construction of the update terms
        nu, s, k, pkk = [], [], [], []
        for comp in self.gmm:
            predicted, h = observer.h(comp.loc)
            nu.append(predicted)
            s.append(h @ comp.cov @ h.T + observer.r)
            k.append(np.linalg.solve(s[-1], h @ comp.cov).T)
            a = np.eye(4) - k[-1] @ h
            pkk.append(a @ comp.cov @ a.T + k[-1] @ observer.r @ k[-1].T)
        # not detected
        newgmm = [
            GmphdComponent(comp.weight * (1 - p), comp.loc, comp.cov, comp.tag)
            for comp, p in zip(self.gmm, pd, strict=True)
        ]
        # detected
        for z in obs:
            newpart = []
            for j, comp in enumerate(self.gmm):
                d = observer.difference(z, nu[j])
                d2 = d @ np.linalg.solve(s[j], d)
                if pd[j] == 0.0 or d2 > 28.0:
                    continue
                q = np.exp(-0.5 * d2) / np.sqrt(np.linalg.det(2 * np.pi * s[j]))
                newcov = pkk[j]
                newpart.append(GmphdComponent(pd[j] * comp.weight * q, comp.loc + k[j] @ d, newcov, comp.tag))
            reweighter = observer.clutter * (1 + BIRTH) + sum(comp.weight for comp in newpart)
            for comp in newpart:
                comp.weight /= reweighter
            newgmm.extend(newpart)
            born = observer.clutter * BIRTH / reweighter
            if born > BIRTH / 15:
                newgmm.append(GmphdComponent(born, *observer.birth(z), self.tags))
                self.tags += 1
        self.gmm = newgmm

    def prune(self, kept_tags):
        rest = [c for c in self.gmm if c.weight > (LOWEST if c.tag in kept_tags else TRUNCATE)]
        rest.sort(key=lambda c: -c.weight)
        merged = []
        while rest:
            first = rest[0]
            near, far = [], []
            for c in rest:
                d = c.loc - first.loc
                joins = c.tag == first.tag and d @ np.linalg.solve(first.cov, d) < MERGE
                (near if joins else far).append(c)
            weight = sum(c.weight for c in near)
            loc = sum(c.weight * c.loc for c in near) / weight
            cov = sum(c.weight * (c.cov + np.outer(c.loc - loc, c.loc - loc)) for c in near) / weight
            merged.append(GmphdComponent(weight, loc, (cov + cov.T) / 2, first.tag))
            rest = far
        self.gmm = merged[:COMPONENTS]

    def split_tags(self):
        """A second object with the tag of another one gets a tag of its own."""
        used = set()
        for comp in sorted(self.gmm, key=lambda c: -c.weight):
            if comp.weight > 0.5 and comp.tag in used:
                comp.tag = self.tags
                self.tags += 1
            used.add(comp.tag)

    def intensity(self):
        sums = {}
        for comp in self.gmm:
            sums[comp.tag] = sums.get(comp.tag, 0.0) + comp.weight
        return sums


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.phd = Gmphd()
        self.present = {}  # tag: scans, time of the last one
        self.ids = {}
        self.time = None

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        observer = Observer(scan)
        self.phd.predict(dt, observer)
        self.phd.update(list(scan.measurement.T), observer)
        self.phd.prune({tag for tag, (_, last) in self.present.items() if scan.time - last < SHOWN_FOR})
        self.phd.split_tags()
        return None, self.extract(scan.time)

    def extract(self, time):
        shown = []
        for tag, intensity in self.phd.intensity().items():
            scans, last = self.present.get(tag, (0, -np.inf))
            if intensity > 0.5:
                scans, last = scans + 1, time
                self.present[tag] = scans, last
            if scans >= SHOWN_AFTER and time - last < SHOWN_FOR:
                number = self.ids.setdefault(tag, len(self.ids))
                best = max((c for c in self.phd.gmm if c.tag == tag), key=lambda c: c.weight)
                shown.append((number, best.loc, best.cov))
        if not shown:
            return None
        ids, locs, covs = zip(*shown, strict=True)
        return np.array(ids), np.stack(locs, axis=-1), np.stack(covs, axis=-1)
