"""Answers the requests of a simulated bus's clients: its status, faults, recovery from bus-off."""

from __future__ import annotations

from typing import Any

from hilbridge.bus.model.medium import Medium
from hilbridge.bus.simulated.requests import FaultsRequest, RecoverRequest, read_request


def status(medium: Medium) -> dict[str, Any]:
    """The bus in plain values; `busy_ns` grows by the time the wire was in use."""
    return {
        "bitrate": medium.bitrate,
        "data_bitrate": medium.data_bitrate,
        "busy_ns": medium.busy_ns,
        "errors": medium.nodes.errors,
        "fault_effects": dict(medium.fault_state.effects),
        "nodes": [
            {
                "number": node.number,
                "name": node.name,
                "state": node.state.value,
                "tec": node.confinement.tec,
                "rec": node.confinement.rec,
                "sent": node.sent,
                "failures": node.failures,
                "arbitration_losses": node.arbitration_losses,
                "lost_frames": node.lost_frames,
                "queued": len(node.queue),
            }
            for node in medium.nodes.all.values()
        ],
    }


def answer(medium: Medium, number: int, raw: bytes, now_ns: int) -> dict[str, Any]:
    """Carry out one request of node `number`; what cannot be read is answered with `error`. Never raises."""
    request = read_request(raw)
    if isinstance(request, str):
        return {"error": request}
    if isinstance(request, FaultsRequest):
        medium.use_faults(request.faults.at(now_ns))
        return {"ok": True}
    if isinstance(request, RecoverRequest):
        medium.recover(number)
        return {"ok": True}
    return status(medium) | {"now_ns": now_ns}
