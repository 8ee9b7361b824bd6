"""Muscles of a joint: a flexor and an extensor with activation dynamics. They push, and they stiffen as they contract."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_sim.plant.parameters import value

_RISES_S, _FALLS_S = value("activation"), value("deactivation")
_STIFFNESS, _DAMPING = value("active_stiffness"), value("active_damping")


def _toward(active: float, excited: float, dt_s: float) -> float:
    slowed = 0.5 + 1.5 * active
    lag_s = _RISES_S * slowed if excited > active else _FALLS_S / slowed
    return active + (excited - active) * (dt_s / (lag_s + dt_s))


@dataclass(slots=True)
class Muscles:
    """Activations 0..1. `strength_nm` is the largest torque to either side."""

    strength_nm: float
    flexor: float = 0.0
    extensor: float = 0.0

    def excite(self, wanted_nm: float, both: float, dt_s: float) -> None:
        """Nerves ask for a torque on top of `both` contracted; more than all is not to be had."""
        share = wanted_nm / self.strength_nm
        flexor, extensor = (both + share, both) if share > 0.0 else (both, both - share)
        self.flexor = _toward(self.flexor, min(1.0, flexor), dt_s)
        self.extensor = _toward(self.extensor, min(1.0, extensor), dt_s)

    def torque_nm(self) -> float:
        """What they pull with."""
        return (self.flexor - self.extensor) * self.strength_nm

    def spring(self) -> tuple[float, float]:
        """Stiffness and damping of contracted muscle, N m/rad and N m s/rad."""
        contracted = min(self.flexor, self.extensor) * 2.0
        return _STIFFNESS * contracted, _DAMPING * contracted
