"""The wire of a simulated bus, broken from the director's process: cuts, bus-off, bit errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hilbridge.bus.client import BusClient, BusNotReachable
from hilbridge.bus.wire_faults import Where
from hilbridge.errors import InputError
from scenarios.faults import Active
from scenarios.schema import BusPart

_ACT_CMD = 0x060
_DESTROYED = 32  # in a row: TEC + 8 each, bus-off at 256
_FOREVER_MS = 1e9


class SimulatedWire:
    """Opens the bus first, at the scenario's bit rate, and stays on it as a node that only listens."""

    def __init__(self, channel: str, bus: BusPart, seed: int) -> None:
        """Raises InputError where there can be no such bus, or where one runs at another bit rate."""
        try:
            self._client = BusClient(channel, listen_only=True, node="wire", bitrate=bus.bitrate)
        except (BusNotReachable, ValueError) as error:
            raise InputError(f"bus hilsim:{channel}: {error}") from None
        bitrate = self._ask({"op": "status"})["bitrate"]
        if bitrate != bus.bitrate:
            self.close()
            raise InputError(
                f"bus hilsim:{channel}: runs at {bitrate} bit/s already; name another with --bus hilsim:NAME"
            )
        self._bus, self._seed = bus, seed
        self._cut: Active | None = None
        self._off: Active | None = None
        self._counted: dict[str, int] = {}
        self._use()

    def begin(self, active: Active) -> None:
        """bus.cut, bus.bus_off."""
        self.settle()
        if active.step.fault == "bus.cut":
            self._cut = active
            self._use()
        else:
            self._off = active
            self._use([{"can_id": _ACT_CMD, "bit": Where.CRC.value, "count": _DESTROYED}])

    def end(self, active: Active) -> None:
        """A cut ends; a bus-off has its own end: the chip comes back by itself."""
        if active is self._cut:
            self.settle()
            self._cut = None
            self._use()

    def settle(self) -> None:
        """Count what the wire's faults have done so far, and take in what was heard."""
        while self._client.receive() is not None:
            pass
        effects = self._ask({"op": "status"})["fault_effects"]
        if self._cut is not None:
            self._cut.took_effect(effects.get("cut", 0) - self._counted.get("cut", 0))
        if self._off is not None and effects.get("corruption", 0) >= _DESTROYED:
            self._off.took_effect()
            self._off = None
        self._counted = effects

    def close(self) -> None:
        """Leave the bus."""
        self._client.close()

    def _use(self, corruptions: Sequence[dict[str, Any]] = ()) -> None:
        status = self._ask({"op": "status"})
        everybody = [node["name"] for node in status["nodes"]]
        faults: dict[str, Any] = {
            "seed": self._seed,
            "bit_error_rate": self._bus.bit_error_rate,
            "cuts": [] if self._cut is None else [{"nodes": everybody, "from_ms": 0, "until_ms": _FOREVER_MS}],
            "corruptions": list(corruptions),
        }
        self._counted = {}
        answer = self._ask({"op": "faults", "faults": faults})
        if "error" in answer:
            raise InputError(f"bus hilsim:{self._client.name}: {answer['error']}")

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        try:
            return self._client.control(request)
        except OSError as error:
            raise InputError(f"bus hilsim:{self._client.name}: {error}") from None
