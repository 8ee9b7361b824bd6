"""BeGaze exports as lines of text."""

from __future__ import annotations

from hilbridge.sensors.begaze import BegazeRecording, parse_begaze

HEADER = ["## [BeGaze]", "## Version:\tBeGaze 3.1.77", "## Sample Rate:\t30", "## Calibration Area:\t1280\t960"]
OLD = "Time\tType\tTrial\tL POR X [px]\tL POR Y [px]\tFrame\tAux1\tL Event Info"


def recording(seconds: int) -> BegazeRecording:
    """Somebody who looks at about the middle, at 30 samples a second."""
    rows = [f"{n}\tSMP\t1\t{640 + n % 7}\t480\t{n * 24 // 30}\t\t-" for n in range(seconds * 30)]
    return parse_begaze([*HEADER, OLD, *rows])
