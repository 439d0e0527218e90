"""The place is a complex number and so is the velocity: two states, a covariance and a pseudo-covariance."""

import numpy as np
from benchmarks.faults.parts import linear_at

SIGMA = 3.0


def augmented(C, D):
    """Of the states and their conjugates."""
    return np.block([[C, D], [D.conj(), C.conj()]])


def of_plane(R):
    """Covariance and pseudo-covariance of x + iy."""
    return R[0, 0] + R[1, 1], R[0, 0] - R[1, 1] + 2j * R[0, 1]


class Tracker:
    def step(self, state, scan):
        if state is None:
            z, _, R = linear_at(scan, np.zeros(2))
            c, d = of_plane(R)
            s, A = np.array([z[0] + 1j * z[1], 0j]), augmented(np.diag([c, 800.0]), np.diag([d, 0j]))
        else:
            time, s, A = state
            s, A = self.moved(s, A, scan.time - time)
            if scan.valid:
                s, A = self.informed(s, A, scan)
        return (scan.time, s, A), self.real(s, A)

    def moved(self, s, A, dt):
        F = np.array([[1.0, dt], [0.0, 1.0]])
        g = SIGMA * np.array([dt**2 / 2, dt])
        both = np.kron(np.eye(2), F)
        return F @ s, both @ A @ both.T + np.kron(np.eye(2), 2 * np.outer(g, g))

    def informed(self, s, A, scan):
        z, H, R = linear_at(scan, np.array([s[1].real, s[1].imag]))
        # A real combination a x + b y is the real part of (a - ib)(x + iy), half of it for each conjugate.
        w = (H[:, [0, 2]] - 1j * H[:, [1, 3]]) / 2
        B = np.hstack([w, w.conj()])
        S = (B @ A @ B.conj().T).real + R
        K = A @ B.conj().T @ np.linalg.inv(S)
        gap = z - (B @ np.concatenate([s, s.conj()])).real
        keep = np.eye(4) - K @ B
        A = keep @ A @ keep.conj().T + K @ R @ K.conj().T
        return s + (K @ gap)[:2], (A + A.conj().T) / 2

    def real(self, s, A):
        C, D = A[:2, :2], A[:2, 2:]
        xx, yy, xy = (C + D).real / 2, (C - D).real / 2, (D - C).imag / 2
        P = np.zeros((4, 4))
        P[::2, ::2], P[1::2, 1::2] = xx, yy
        P[::2, 1::2], P[1::2, ::2] = xy, xy.T
        mean = np.array([s[0].real, s[0].imag, s[1].real, s[1].imag])
        return mean, (P + P.T) / 2
