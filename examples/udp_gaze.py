"""An eye tracker of one's own as `hilbridge run --gaze udp:5005` takes it: samples by UDP, probes of its clock answered."""

import contextlib
import json
import math
import socket
import sys
import time


def main(host: str = "127.0.0.1", port: int = 5005, seconds: float = math.inf) -> None:
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.connect((host, port))
    link.settimeout(0.01)  # one sample every 10 ms
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        x, y = 0.5 + 0.2 * math.sin(time.monotonic()), 0.5  # of the scene picture, from its top left
        sample = {"t_ns": time.monotonic_ns(), "x": x, "y": y, "valid": True, "worn": True}
        with contextlib.suppress(OSError):  # nobody listens yet, or nothing was asked
            link.send(json.dumps(sample).encode() + b"\n")
            probe = json.loads(link.recv(1000))
            link.send(json.dumps({"probe": probe["probe"], "t_ns": time.monotonic_ns()}).encode() + b"\n")


if __name__ == "__main__":
    main(*sys.argv[1:2], *map(int, sys.argv[2:3]))
