"""Wire faults of a simulated bus, made from the director's process: cuts, bus-off, bit errors, a full bus."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

from hilbridge.bus.model.faults import Where
from hilbridge.bus.simulated.client import BusClient, BusNotReachable, Rates
from hilbridge.errors import InputError
from hilscenario.format.schema import BusPart
from hilscenario.format.vocabulary import WIRE_FAULTS
from hilscenario.world.fault_board import Active

_NODE = "wire"
_FRAME_BITS = 135  # of 8 bytes, with the stuff bits of a payload like ours
_ACT_CMD = 0x060
_DESTROYED = 32  # in a row: TEC + 8 each, bus-off at 256
_FOREVER_MS = 1e9


class SimulatedWire:
    """Opens the bus first, at the scenario's bit rate, and stays on it as a node that sends only babble."""

    def __init__(self, channel: str, bus: BusPart, seed: int) -> None:
        """Raises InputError where there can be no such bus, or where one runs at another bit rate."""
        try:
            self._client = BusClient(channel, node=_NODE, rates=Rates(bus.bitrate))
        except (BusNotReachable, ValueError) as error:
            raise InputError(f"bus hilsim:{channel}: {error}") from None
        bitrate = self._ask({"op": "status"})["bitrate"]
        if bitrate != bus.bitrate:
            self._client.close()
            raise InputError(
                f"bus hilsim:{channel}: runs at {bitrate} bit/s already; name another with --bus hilsim:NAME"
            )
        self._bus, self._seed = bus, seed
        self._lasting: dict[str, Active] = {}  # cut and babble, by name
        self._off: Active | None = None
        self._counted: dict[str, int] = {}
        self._use()

    def can(self, active: Active) -> bool:
        """Whether this fault is the wire's: a cut, a bus-off, or a babbling node that leaves no room for others."""
        full = active.step.fault == "bus.babble" and active["per_s"] * _FRAME_BITS >= self._bus.bitrate
        return full or active.step.fault in WIRE_FAULTS

    def begin(self, active: Active) -> None:
        """One for which `can` is true."""
        self.settle()
        if active.step.fault == "bus.bus_off":
            self._off = active
            self._use([{"can_id": _ACT_CMD, "bit": Where.CRC.value, "count": _DESTROYED}])
        else:
            self._lasting[active.step.fault] = active
            self._use()

    def end(self, active: Active) -> None:
        """Cut and babble end; a bus-off has its own end: the chip comes back by itself."""
        if self._lasting.get(active.step.fault) is active:
            self.settle()
            del self._lasting[active.step.fault]
            self._use()

    def settle(self) -> None:
        """Count what the wire's faults have done so far, and take in what was heard."""
        while self._client.receive() is not None:
            pass
        effects = self._ask({"op": "status"})["fault_effects"]
        for fault, active in self._lasting.items():
            name = fault.removeprefix("bus.")
            active.took_effect(effects.get(name, 0) - self._counted.get(name, 0))
        if self._off is not None and effects.get("corruption", 0) >= _DESTROYED:
            self._off.took_effect()
            self._off = None
        self._counted = effects

    def close(self) -> None:
        """Leave the bus without faults: it outlives its nodes by some seconds."""
        self._lasting.clear()
        with contextlib.suppress(InputError):  # it has gone already
            self._use()
        self._client.close()

    def _use(self, corruptions: Sequence[dict[str, Any]] = ()) -> None:
        status = self._ask({"op": "status"})
        everybody = [node["name"] for node in status["nodes"]]
        babble = self._lasting.get("bus.babble")
        faults: dict[str, Any] = {
            "seed": self._seed,
            "bit_error_rate": self._bus.bit_error_rate,
            "cuts": [{"nodes": everybody, "from_ms": 0, "until_ms": _FOREVER_MS}] if "bus.cut" in self._lasting else [],
            "babbles": [] if babble is None else [{"node": _NODE, "can_id": round(babble["can_id"]), "from_ms": 0}],
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
