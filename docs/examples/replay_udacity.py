"""Plays the Udacity simulator: sends a recording to a server, line by line, and prints the last answer."""

import json
import sys
from pathlib import Path

from websockets.sync.client import connect


def main(file: str, port: str = "4567") -> None:
    answer = "nothing was sent"
    with connect(f"ws://127.0.0.1:{port}/socket.io/?EIO=4&transport=websocket") as server:
        for line in Path(file).read_text(encoding="utf-8").splitlines():
            server.send("42" + json.dumps(["telemetry", {"sensor_measurement": line}]))
            answer = str(server.recv())
    print(answer)


if __name__ == "__main__":
    main(*sys.argv[1:])
