"""A Gaussian mixture PHD filter, whose terms carry the label of the detection that they began with."""

import numpy as np
from benchmarks.faults import parts

BORN, LEAST, LIVES = 0.01, 1e-5, 20.0  # weight of a birth, least weight of a term, mean life in s
UNSEEN = 1.0  # s: mean life out of view
CONFIRM = 3  # scans with a weight above one half, before a label is shown
HOLD = 0.5  # s: a label is shown for so long after its weight was last above one half


class Tracker:
    identities = "hidden"

    def __init__(self, sigma=3.0):
        self.sigma = sigma

    def step(self, state, scan):
        state = state or {"time": scan.time, "terms": [], "next": 0, "ids": {}, "strong": {}}
        dt = scan.time - state["time"]
        terms = []
        for w, x, P, label in state["terms"]:
            x, P = parts.moved(x, P, dt, self.sigma)
            terms.append((w * np.exp(-dt / (LIVES if parts.in_view(x, scan) else UNSEEN)), x, P, label))
        terms, following = self.updated(terms, scan, state["next"])
        held = {label for label, (time, _) in state["strong"].items() if scan.time - time <= HOLD}
        terms = self.reduced(terms, held)
        terms, following = divided(terms, following)
        ids, strong, shown = dict(state["ids"]), dict(state["strong"]), []
        for label, w in weights_of(terms).items():
            if w > 0.5:
                strong[label] = scan.time, strong.get(label, (0, 0))[1] + 1
                if strong[label][1] >= CONFIRM:
                    ids.setdefault(label, len(ids))
            if label in ids and scan.time - strong[label][0] <= HOLD:
                shown.append((ids[label], *max((t for t in terms if t[3] == label), key=lambda t: t[0])[1:3]))
        after = {"time": scan.time, "terms": terms, "next": following, "ids": ids, "strong": strong}
        if not shown:
            return after, None
        numbers, means, covariances = zip(*shown, strict=True)
        return after, (np.array(numbers), np.stack(means, -1), np.stack(covariances, -1))

    def updated(self, terms, scan, label):
        detected = [min(scan.detection_probability, 0.98) if parts.in_view(x, scan) else 0.0 for _, x, _, _ in terms]
        after = [(w * (1 - d), x, P, name) for (w, x, P, name), d in zip(terms, detected, strict=True)]
        for column in scan.measurement.T:
            z, H, R = parts.linear(scan, column)
            area = column[0] if scan.kind == "radar" else 1.0
            clutter = max(scan.clutter_density / area, 1e-8)
            new = []
            for (w, x, P, name), d in zip(terms, detected, strict=True):
                y, S = z - H @ x, H @ P @ H.T + R
                d2 = y @ np.linalg.solve(S, y)
                if d == 0 or d2 > 25.0:
                    continue
                q = np.exp(-d2 / 2) / np.sqrt(np.linalg.det(2 * np.pi * S))
                new.append((w * d * q, *parts.updated(x, P, z, H, R), name))
            # A birth is as likely anywhere: its density among the detections is in proportion to that of clutter.
            whole = clutter * (1 + BORN) + sum(w for w, _, _, _ in new)
            after += [(w / whole, x, P, name) for w, x, P, name in new]
            birth = clutter * BORN / whole
            if birth > BORN / 20:
                x, P = np.array([*z[:2], 0.0, 0.0]), np.diag([1e4, 1e4, 400.0, 400.0])
                after.append((birth, *parts.updated(x, P, z, H, R), label))
                label += 1
        return after, label

    def reduced(self, terms, held):
        """Terms of one label that are near each other become one; light ones go, unless their label is shown."""
        left, result = sorted((t for t in terms if t[0] > (1e-12 if t[3] in held else LEAST)), key=lambda t: -t[0]), []
        while left:
            top = left[0]
            inverse = np.linalg.inv(top[2])
            near = [t for t in left if t[3] == top[3] and (t[1] - top[1]) @ inverse @ (t[1] - top[1]) < 9.0]
            left = [t for t in left if not any(t is n for n in near)]
            w = sum(t[0] for t in near)
            x = sum(t[0] * t[1] for t in near) / w
            P = sum(t[0] * (t[2] + np.outer(t[1] - x, t[1] - x)) for t in near) / w
            result.append((w, x, (P + P.T) / 2, top[3]))
        return result[:60]


def divided(terms, following):
    """A second object under one label, of which the first is the heavier one, gets a label of its own."""
    known, result = set(), []
    for w, x, P, label in sorted(terms, key=lambda t: -t[0]):
        if w > 0.5 and label in known:
            label, following = following, following + 1
        known.add(label)
        result.append((w, x, P, label))
    return result, following


def weights_of(terms):
    sums = {}
    for w, _, _, label in terms:
        sums[label] = sums.get(label, 0.0) + w
    return sums
