"""The motor and its current loop: a first-order lag with a torque limit, and the faults a motor can have.

Torque in N m. Faults are options of the plant, not of the controller, which has to notice them.
"""

from __future__ import annotations

from dataclasses import dataclass

LAG_S = 0.0015
LIMIT_NM = 6.0


@dataclass(slots=True)
class Actuator:
    """Present torque; `stuck` freezes it, `gain` scales what is asked (1.0 is healthy), `bias_nm` comes on top."""

    torque_nm: float = 0.0
    gain: float = 1.0
    stuck: bool = False
    lag_s: float = LAG_S
    bias_nm: float = 0.0

    def step(self, asked_nm: float, dt_s: float) -> None:
        """Follow the asked torque for `dt_s`."""
        if self.stuck:
            return
        wanted = asked_nm * self.gain + self.bias_nm
        if not -LIMIT_NM <= wanted <= LIMIT_NM:
            wanted = LIMIT_NM if wanted > 0.0 else -LIMIT_NM
        self.torque_nm += (wanted - self.torque_nm) * (dt_s / (self.lag_s + dt_s))
