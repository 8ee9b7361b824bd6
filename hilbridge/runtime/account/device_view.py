"""The device as the bridge hears it: CTRL_STATUS and CTRL_MEAS folded into one row. Pure."""

from __future__ import annotations

from dataclasses import replace

from hilbridge.rows import DeviceRow, Witness
from hilbridge.wire.codec import Decoded


class DeviceView:
    """Holds the newest of both messages; every new one gives a row with all that is known."""

    def __init__(self) -> None:
        self._row: DeviceRow | None = None

    def take(self, decoded: Decoded, now_ns: int) -> DeviceRow | None:
        """The row after an accepted message; None for other messages, and before the first CTRL_STATUS."""
        signals = decoded.signals
        if decoded.name == "CTRL_STATUS":
            heard = DeviceRow(
                now_ns,
                Witness.BUS,
                str(signals["State"]),
                str(signals["Reason"]),
                bool(signals["Armed"]),
                str(signals["AppliedVerb"]),
                bool(signals["AssistZero"]),
                authority=float(signals["Authority"]),
            )
            before = self._row
            if before is not None:
                heard = replace(
                    heard,
                    assist_nm=before.assist_nm,
                    gravity_nm=before.gravity_nm,
                    angle_deg=before.angle_deg,
                    velocity_deg_s=before.velocity_deg_s,
                )
            self._row = heard
        elif decoded.name == "CTRL_MEAS" and self._row is not None:
            self._row = replace(
                self._row,
                time_ns=now_ns,
                assist_nm=float(signals["AssistTorque"]),
                gravity_nm=float(signals["GravityTorque"]),
                angle_deg=float(signals["Angle"]),
                velocity_deg_s=float(signals["Velocity"]),
            )
        else:
            return None
        return self._row
