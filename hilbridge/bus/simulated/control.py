"""Requests to the process that owns a simulated bus: its status, faults, recovery from bus-off. JSON in and out."""

from __future__ import annotations

import json
import math
from typing import Any

from hilbridge.bus.model.faults import Babble, Corruption, QueueStall, Where, WireCut, WireFaults
from hilbridge.bus.model.medium import Medium


def faults_from_json(given: dict[str, Any], now_ns: int) -> WireFaults:
    """A WireFaults from plain values. Times `from_ms` and `until_ms` count from `now_ns`.

    Raises ValueError, TypeError or KeyError, whose text names the entry, for anything it cannot read.
    """
    known = {"seed", "bit_error_rate", "local_share", "corruptions", "babbles", "cuts", "stalls", "no_ack"}
    if unknown := set(given) - known:
        raise ValueError(f"unknown fault {sorted(unknown)[0]!r}; known are {', '.join(sorted(known))}")
    return WireFaults(
        seed=int(given.get("seed", 0)),
        bit_error_rate=float(given.get("bit_error_rate", 0.0)),
        local_share=float(given.get("local_share", 0.0)),
        corruptions=tuple(_corruption(_timed(entry, now_ns)) for entry in given.get("corruptions", ())),
        babbles=tuple(_babble(_timed(entry, now_ns)) for entry in given.get("babbles", ())),
        cuts=tuple(_cut(_timed(entry, now_ns)) for entry in given.get("cuts", ())),
        stalls=tuple(QueueStall(**_timed(entry, now_ns)) for entry in given.get("stalls", ())),
        no_ack=frozenset(str(name) for name in given.get("no_ack", ())),
    )


def _timed(entry: dict[str, Any], now_ns: int) -> dict[str, Any]:
    times = {"from_ms": "from_ns", "until_ms": "until_ns"}
    plain = {key: value for key, value in entry.items() if key not in times}
    return plain | {times[key]: now_ns + int(entry[key] * 1e6) for key in times if key in entry}


def _corruption(entry: dict[str, Any]) -> Corruption:
    bit = entry.get("bit", Where.DATA)
    return Corruption(**entry | {"bit": bit if isinstance(bit, int) else Where(bit)})


def _babble(entry: dict[str, Any]) -> Babble:
    return Babble(**entry | ({"data": bytes.fromhex(entry["data"])} if "data" in entry else {}))


def _cut(entry: dict[str, Any]) -> WireCut:
    return WireCut(**entry | {"nodes": frozenset(entry["nodes"])})


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


def _finite(text: str) -> float:
    """A number that is one: 1e999, NaN and Infinity would end the bus later, where nobody expects them."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text} is not a finite number")
    return number


def answer(medium: Medium, number: int, request: bytes, now_ns: int) -> dict[str, Any]:
    """Carry out one request of node `number`; what cannot be read is answered with `error`. Never raises."""
    try:
        given = json.loads(request, parse_float=_finite, parse_constant=_finite)
        operation = given["op"]
        if operation == "status":
            return status(medium) | {"now_ns": now_ns}
        if operation == "recover":
            medium.recover(number)
            return {"ok": True}
        if operation == "faults":
            medium.use_faults(faults_from_json(given["faults"], now_ns))
            return {"ok": True}
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        return {"error": f"{type(error).__name__}: {error}"}
    return {"error": f"unknown request {operation!r}; known are status, recover, faults"}
