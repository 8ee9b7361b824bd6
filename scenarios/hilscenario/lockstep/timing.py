"""Profiles a lockstep run: processor time of the calls between its parts."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from hilscenario.lockstep.engine import Lockstep


class Profile:
    """Processor time by part. Parts within parts are taken off the outer one."""

    def __init__(self) -> None:
        self._spent_ns: dict[str, int] = {}
        self._inner_ns = [0]

    def timed(self, part: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """`call`, with its time booked under `part`."""
        spent, inner, clock = self._spent_ns, self._inner_ns, time.perf_counter_ns

        def wrapped(*arguments: Any, **named: Any) -> Any:
            inner.append(0)
            begin = clock()
            try:
                return call(*arguments, **named)
            finally:
                took = clock() - begin
                spent[part] = spent.get(part, 0) + took - inner.pop()
                inner[-1] += took

        return wrapped

    def per_second(self, seconds: float, cpu_s: float) -> dict[str, float]:
        """Milliseconds per second of the system's life; `engine and the rest` is what no part has."""
        rows = {part: ns / 1e6 / seconds for part, ns in self._spent_ns.items()}
        rows["engine and the rest"] = max(0.0, cpu_s * 1e3 / seconds - sum(rows.values()))
        return rows


def profiled(world: Lockstep) -> Profile:
    """Put a clock around the parts of a world that has not run yet."""
    profile, side = Profile(), world.bridge

    def put(owner: Any, name: str, part: str) -> None:
        setattr(owner, name, profile.timed(part, getattr(owner, name)))

    put(world.device_side, "tick_device", "controller, actuator and arm")
    put(world.device_side, "coast_device", "controller, actuator and arm")
    put(world.device_side.probe, "look", "signals of the device")
    put(world.device_side.probe, "pass_by", "signals of the device")
    put(world.bus.network, "pump", "bit-level bus")
    put(world.body, "frame", "wearer: rendered pictures")
    put(world.body, "gaze", "wearer: gaze")
    put(world.body, "hands", "wearer: hands")
    put(side.senses, "see", "features")
    put(side.predictor, "step", "predictor")
    put(side.node, "tick", "gate and protocol")
    put(side.node, "receive", "bridge's codec, receiving")
    put(side, "_note", "signals of the bridge")
    return profile
