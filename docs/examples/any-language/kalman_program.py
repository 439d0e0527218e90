import struct
import sys

import msgpack
import numpy as np


def array(value):
    return np.frombuffer(value[1], "<f8").reshape(value[0])


def send(**message):
    content = msgpack.packb(message)
    sys.stdout.buffer.write(struct.pack("<I", len(content)) + content)
    sys.stdout.buffer.flush()


states = {}
while head := sys.stdin.buffer.read(4):
    message = msgpack.unpackb(sys.stdin.buffer.read(*struct.unpack("<I", head)))
    if message["type"] == "hello":
        q = message["options"].get("acceleration", 3.0)
        send(type="hello", version=1, name="Kalman filter of positions", copies=True)
    elif message["type"] == "copy" and message["of"] in states:
        states[message["id"]] = states[message["of"]]
    elif message["type"] == "end":
        states.pop(message["id"], None)
    elif message["type"] == "scan":
        time, z, (x, y, yaw) = message["time"], array(message["measurement"]), array(message["sensor_pose"])
        r, angle = (z[0], yaw + z[1]) if message["kind"] == "radar" else (np.hypot(*z), yaw + np.arctan2(z[1], z[0]))
        turn = yaw if message["kind"] == "lidar" else angle
        J = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        J[:, 1] *= r if message["kind"] == "radar" else 1.0  # errors of the measurement in the fixed frame
        before, mean, P = states.get(message["id"], (time, np.zeros(4), np.diag([1e6, 1e6, 400.0, 400.0])))
        F, G = np.eye(4) + (time - before) * np.eye(4, k=2), np.vstack([np.eye(2) * (time - before) / 2, np.eye(2)])
        mean, P = F @ mean, F @ P @ F.T + (q * (time - before)) ** 2 * G @ G.T
        if array(message["valid"]):
            K = P[:, :2] @ np.linalg.inv(P[:2, :2] + J @ array(message["noise_covariance"])[:2, :2] @ J.T)
            mean, P = mean + K @ ([x + r * np.cos(angle), y + r * np.sin(angle)] - mean[:2]), P - K @ P[:2]
        states[message["id"]] = time, mean, (P + P.T) / 2
        send(type="estimate", id=message["id"], mean=[[4], mean.tobytes()], covariance=[[4, 4], P.tobytes()])
