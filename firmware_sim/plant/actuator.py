"""The motor and its current loop: a first-order lag with a torque limit, and the faults a motor can have.

Torque in N m. Faults are options of the plant, not of the controller, which has to notice them.
"""

from __future__ import annotations

from dataclasses import dataclass

LAG_S = 0.0015
LIMIT_NM = 6.0


@dataclass(slots=True)  # not frozen: one is made every millisecond
class Actuator:
    """Present torque; `stuck` freezes it, `gain` scales what is asked (1.0 is healthy), `bias_nm` comes on top."""

    torque_nm: float = 0.0
    gain: float = 1.0
    stuck: bool = False
    lag_s: float = LAG_S
    bias_nm: float = 0.0

    def step(self, asked_nm: float, dt_s: float) -> Actuator:
        """Follow the asked torque for `dt_s`."""
        if self.stuck:
            return self
        wanted = max(-LIMIT_NM, min(LIMIT_NM, asked_nm * self.gain + self.bias_nm))
        share = dt_s / (self.lag_s + dt_s)
        torque_nm = self.torque_nm + (wanted - self.torque_nm) * share
        return Actuator(torque_nm, self.gain, self.stuck, self.lag_s, self.bias_nm)
