"""Carried over from FORTRAN: north, east and compass bearings, indices from 1, and Potter's root, by numbers."""
# ruff: noqa: E741

import numpy as np


class COMMON:
    """X(1..4): NORTH, EAST, VN, VE. W: P = W W'."""

    def __init__(self):
        self.X = np.zeros(5)
        self.W = np.zeros((5, 5))
        self.T = 0.0

    def COPY(self):
        OTHER = COMMON()
        OTHER.X, OTHER.W, OTHER.T = self.X.copy(), self.W.copy(), self.T
        return OTHER


def START(C, Z, R):
    ROOT = np.linalg.cholesky(R)
    for I in (1, 2):
        C.X[I] = Z[I - 1]
        for J in (1, 2):
            C.W[I, J] = ROOT[I - 1, J - 1]
    C.W[3, 3] = C.W[4, 4] = 20.0


def PROPAG(C, T, SIGACC=3.0):
    DT = T - C.T
    C.T = T
    C.X[1] += DT * C.X[3]
    C.X[2] += DT * C.X[4]
    ROWS = np.zeros((6, 4))
    for J in range(1, 5):
        ROWS[J - 1, 0] = C.W[1, J] + DT * C.W[3, J]
        ROWS[J - 1, 1] = C.W[2, J] + DT * C.W[4, J]
        ROWS[J - 1, 2] = C.W[3, J]
        ROWS[J - 1, 3] = C.W[4, J]
    ROWS[4, 0], ROWS[4, 2] = SIGACC * DT * DT / 2, SIGACC * DT
    ROWS[5, 1], ROWS[5, 3] = SIGACC * DT * DT / 2, SIGACC * DT
    C.W[1:, 1:] = np.linalg.qr(ROWS, mode="r").T


def POTTER(C, H, RES, VAR):
    V = np.zeros(5)
    for J in range(1, 5):
        for I in range(1, 5):
            V[J] += C.W[I, J] * H[I]
    ALPHA = VAR
    for J in range(1, 5):
        ALPHA += V[J] ** 2
    GAMMA = 1.0 / (1.0 + np.sqrt(VAR / ALPHA))
    for I in range(1, 5):
        G = 0.0
        for J in range(1, 5):
            G += C.W[I, J] * V[J]
        C.X[I] += G * RES / ALPHA
        for J in range(1, 5):
            C.W[I, J] -= GAMMA / ALPHA * G * V[J]


def COMPAS(ANGLE):
    """Bearing from north, clockwise, of an angle from east, the other way."""
    return np.pi / 2 - ANGLE


def RADAR(C, SCAN):
    SN, SE = SCAN.sensor_pose[1], SCAN.sensor_pose[0]
    DN, DE = C.X[1] - SN, C.X[2] - SE
    UN, UE = C.X[3] - SCAN.sensor_velocity[1], C.X[4] - SCAN.sensor_velocity[0]
    RANGE = np.sqrt(DN**2 + DE**2)
    BRG = np.arctan2(DE, DN)
    CB, SB = np.cos(BRG), np.sin(BRG)
    RDOT = UN * CB + UE * SB
    BDOT = (UE * CB - UN * SB) / RANGE
    OBS = COMPAS(SCAN.sensor_pose[2] + SCAN.measurement[1])
    RESB = np.arctan2(np.sin(OBS - BRG), np.cos(OBS - BRG))
    HS = [
        (0.0, CB, SB, 0.0, 0.0),
        (0.0, -SB / RANGE, CB / RANGE, 0.0, 0.0),
        (0.0, -SB * BDOT, CB * BDOT, CB, SB),
    ]
    RES = [SCAN.measurement[0] - RANGE, RESB, SCAN.measurement[2] - RDOT]
    X0 = C.X.copy()
    for K in range(3):
        LEFT = RES[K]
        for I in range(1, 5):
            LEFT -= HS[K][I] * (C.X[I] - X0[I])
        POTTER(C, HS[K], LEFT, SCAN.noise_covariance[K, K])


def LIDAR(C, SCAN):
    CY, SY = np.cos(SCAN.sensor_pose[2]), np.sin(SCAN.sensor_pose[2])
    HS = [(0.0, SY, CY, 0.0, 0.0), (0.0, CY, -SY, 0.0, 0.0)]
    OFF = [CY * SCAN.sensor_pose[0] + SY * SCAN.sensor_pose[1], CY * SCAN.sensor_pose[1] - SY * SCAN.sensor_pose[0]]
    for K in range(2):
        RES = SCAN.measurement[K] + OFF[K] - HS[K][1] * C.X[1] - HS[K][2] * C.X[2]
        POTTER(C, HS[K], RES, SCAN.noise_covariance[K, K])


def PLACE(SCAN):
    """North, east, and their covariance."""
    E, N, YAW = SCAN.sensor_pose
    if SCAN.kind == "radar":
        R, B = SCAN.measurement[0], COMPAS(YAW + SCAN.measurement[1])
        D = np.array([[np.cos(B), R * np.sin(B)], [np.sin(B), -R * np.cos(B)]])
        Z = np.array([N + R * np.cos(B), E + R * np.sin(B)])
    else:
        D = np.array([[np.sin(YAW), np.cos(YAW)], [np.cos(YAW), -np.sin(YAW)]])
        Z = np.array([N, E]) + D @ SCAN.measurement
    return Z, D @ SCAN.noise_covariance[:2, :2] @ D.T


class Tracker:
    def step(self, state, scan):
        if state is None:
            C = COMMON()
            C.T = scan.time
            START(C, *PLACE(scan))
        else:
            C = state.COPY()
            PROPAG(C, scan.time)
            if scan.valid:
                (RADAR if scan.kind == "radar" else LIDAR)(C, scan)
        P = C.W[1:, 1:] @ C.W[1:, 1:].T
        EAST_FIRST = [1, 0, 3, 2]
        return C, (C.X[1:][EAST_FIRST], P[np.ix_(EAST_FIRST, EAST_FIRST)])
