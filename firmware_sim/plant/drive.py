"""A joint's drive: dead time, lag, limit, winding heat. Its friction and inertia are the mechanics' (`worn.py`)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from firmware_sim.plant.parameters import Preset, value

_AMBIENT, _WARM, _HOT, _COPPER = (value(name) for name in ("ambient", "winding_warm", "winding_hot", "copper"))


@dataclass(slots=True)
class Drive:
    """Torque at the joint and temperature of the winding; one call of `step` a millisecond."""

    preset: Preset
    torque_nm: float = 0.0
    winding_c: float = _AMBIENT
    _on_the_way: deque[float] = field(init=False)

    def __post_init__(self) -> None:
        self._on_the_way = deque([0.0] * round(self.preset.dead_s * 1000))

    def limit_nm(self) -> float:
        """What the winding bears at its temperature."""
        left = (_HOT - self.winding_c) / (_HOT - _WARM)
        return self.preset.limit_nm * max(0.0, min(1.0, left))

    def step(self, asked_nm: float, dt_s: float) -> float:
        """Follow what was asked, dead time ago; the torque that the joint feels."""
        self._on_the_way.append(asked_nm)
        wanted, limit = self._on_the_way.popleft(), self.limit_nm()
        wanted = max(-limit, min(limit, wanted))
        self.torque_nm += (wanted - self.torque_nm) * (dt_s / (self.preset.lag_s + dt_s))
        self._warm(dt_s)
        return self.torque_nm

    def _warm(self, dt_s: float) -> None:
        preset = self.preset
        current = self.torque_nm / preset.nm_per_ampere
        watt = current * current * preset.ohm * (1.0 + _COPPER * (self.winding_c - 20.0))
        watt -= (self.winding_c - _AMBIENT) / preset.kelvin_per_watt
        self.winding_c += watt * dt_s / preset.joule_per_kelvin
