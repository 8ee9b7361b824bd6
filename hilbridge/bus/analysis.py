"""Worst-case response times of a message set under bitwise arbitration, and bus load.

The method is that of Tindell, Burns and Wellings (1995) as corrected by Davis, Burns, Bril and Lukkien, "Controller Area
Network (CAN) schedulability analysis: refuted, revisited and revised", Real-Time Systems 35 (2007): fixed priority,
non-preemptive, all instances within the priority-level busy period examined. Each node sends its most urgent waiting
frame first. All times are integers in nanoseconds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from hilbridge.bus.model.bits import INTERMISSION_BITS, frame_length
from hilbridge.bus.model.frames import WireFrame, arbitration_key
from hilbridge.errors import InputError
from hilbridge.limits import MS

NS_PER_S = 1_000_000_000
EVENT_DISTANCE_MS = 10.0  # the protocol repeats STOP every 10 ms; nothing is sent faster on purpose
MIN_BITRATE, MAX_BITRATE = 10_000, 1_000_000
_ERROR_FRAME_BITS = 31  # error flag, superposition, delimiter, intermission (Tindell 1995)


@dataclass(frozen=True, slots=True)
class Stream:
    """One message of the set: how long its frames are at worst, how often they come, by when they must have arrived.

    `frame_bits` counts the intermission too. `period_ns` is the least time between two of them. `is_event`: no cycle is
    defined and the period is an assumption.
    """

    name: str
    can_id: int
    key: int
    payload_bytes: int
    frame_bits: int
    period_ns: int
    deadline_ns: int
    jitter_ns: int = 0
    is_event: bool = False


@dataclass(frozen=True, slots=True)
class Response:
    """A stream's worst case from queueing to the end of its frame (intermission included); None: it may wait for ever."""

    stream: Stream
    worst_ns: int | None

    @property
    def margin_ns(self) -> int | None:
        """Time left to the deadline; negative where it can be missed."""
        return None if self.worst_ns is None else self.stream.deadline_ns - self.worst_ns


def worst_frame_bits(payload_bytes: int, *, extended: bool = False) -> int:
    """Bits of the longest classical frame, with stuff bits and intermission (Davis et al. 2007, equation 1)."""
    stuffable = (54 if extended else 34) + 8 * payload_bytes
    return stuffable + 13 + (stuffable - 1) // 4


def exact_frame_bits(frame: WireFrame) -> int:
    """Bits of one classical frame as it is, with intermission."""
    return frame_length(frame).nominal_bits + INTERMISSION_BITS


def load(streams: Sequence[Stream], bitrate: int) -> float:
    """The share of time the bus is in use when every stream is as frequent and as long as it can be."""
    return sum(stream.frame_bits * NS_PER_S / bitrate / stream.period_ns for stream in streams)


def responses(streams: Sequence[Stream], bitrate: int, *, error_interval_ns: int | None = None) -> list[Response]:
    """The worst case of each stream, most urgent first. `error_interval_ns`: one error frame in each such interval.

    Raises InputError where two streams have the same arbitration field.
    """
    ordered = sorted(streams, key=lambda stream: stream.key)
    if len({stream.key for stream in ordered}) < len(ordered):
        raise InputError("two messages have one identifier; on a bus they would destroy each other: change the DBC")
    return [
        Response(stream, _worst_ns(ordered, index, bitrate, error_interval_ns)) for index, stream in enumerate(ordered)
    ]


def _ceil(numerator: int, denominator: int) -> int:
    return -(-numerator // denominator)


def _worst_ns(ordered: Sequence[Stream], index: int, bitrate: int, error_interval_ns: int | None) -> int | None:
    bit_ns = NS_PER_S // bitrate

    def duration(stream: Stream) -> int:
        return stream.frame_bits * NS_PER_S // bitrate

    stream, own = ordered[index], duration(ordered[index])
    urgent = [(duration(other), other) for other in ordered[:index]]
    blocking = max((duration(other) for other in ordered[index + 1 :]), default=0)
    if sum(cost / other.period_ns for cost, other in urgent) + own / stream.period_ns >= 1.0:
        return None
    longest = max([own, *(cost for cost, _ in urgent)])

    def errors(within_ns: int) -> int:
        if error_interval_ns is None:
            return 0
        return _ceil(within_ns, error_interval_ns) * (_ERROR_FRAME_BITS * bit_ns + longest)

    def arrivals(window_ns: int) -> int:
        return sum(_ceil(window_ns + other.jitter_ns, other.period_ns) * cost for cost, other in urgent)

    def busy(now_ns: int) -> int:
        return blocking + errors(now_ns) + arrivals(now_ns) + _ceil(now_ns + stream.jitter_ns, stream.period_ns) * own

    def waiting(before_ns: int, now_ns: int) -> int:
        return before_ns + errors(now_ns + own) + arrivals(now_ns + bit_ns)

    busy_ns = _fixed_point(busy, own)
    if busy_ns is None:
        return None
    worst = 0
    for instance in range(_ceil(busy_ns + stream.jitter_ns, stream.period_ns)):
        before = blocking + instance * own
        waits = _fixed_point(partial(waiting, before), before)
        if waits is None:
            return None
        worst = max(worst, stream.jitter_ns + waits - instance * stream.period_ns + own)
    return worst


def _fixed_point(step: Callable[[int], int], start: int) -> int | None:
    """The least fixed point reached from `start`; None where it lies beyond a minute, which is no bus to be used."""
    value = start
    while value < 60 * NS_PER_S:
        following = step(value)
        if following == value:
            return value
        value = following
    return None


def streams_of_dbc(path: Path, *, event_distance_ms: float = EVENT_DISTANCE_MS) -> list[Stream]:
    """The message set of a DBC file: cycles from GenMsgCycleTime, deadlines from RxTimeoutMs where that is the shorter.

    A message without a cycle is an event that comes at most every `event_distance_ms`. Raises InputError for a file
    that is missing or no DBC.
    """
    import cantools

    try:
        database: Any = cantools.database.load_file(str(path), database_format="dbc", strict=False)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; give a DBC file; `hilbridge dbc` prints ours") from error
    except Exception as error:  # cantools raises whatever its parser meets
        raise InputError(f"{path}: no DBC file; `hilbridge dbc --out FILE` writes ours") from error
    streams = []
    for message in database.messages:
        attributes: Mapping[str, Any] = message.dbc.attributes if message.dbc else {}
        timeout = attributes.get("RxTimeoutMs")
        cycle_ms = message.cycle_time or event_distance_ms
        deadline_ms = min(cycle_ms, timeout.value) if timeout is not None and timeout.value else cycle_ms
        frame = WireFrame(message.frame_id, bytes(message.length), message.is_extended_frame)
        streams.append(
            Stream(
                message.name,
                message.frame_id,
                arbitration_key(frame),
                message.length,
                worst_frame_bits(message.length, extended=message.is_extended_frame),
                int(cycle_ms * MS),
                int(deadline_ms * MS),
                is_event=not message.cycle_time,
            )
        )
    return streams


def with_exact_bits(streams: Sequence[Stream], frames: Mapping[int, WireFrame]) -> list[Stream]:
    """The same set with the true length of given frames (by identifier) in place of the bound."""
    return [
        replace(stream, frame_bits=exact_frame_bits(frames[stream.can_id])) if stream.can_id in frames else stream
        for stream in streams
    ]


def report(streams: Sequence[Stream], bitrate: int, *, error_interval_ns: int | None = None) -> dict[str, Any]:
    """Load and worst cases in plain values, as `hilbridge bus-analysis --json` prints them; times in milliseconds."""
    found = responses(streams, bitrate, error_interval_ns=error_interval_ns)
    entries = []
    for response in found:
        stream, worst, margin = response.stream, response.worst_ns, response.margin_ns
        entries.append(
            {
                "name": stream.name,
                "id": stream.can_id,
                "payload_bytes": stream.payload_bytes,
                "frame_bits": stream.frame_bits,
                "period_ms": stream.period_ns / MS,
                "period_assumed": stream.is_event,
                "deadline_ms": stream.deadline_ns / MS,
                "worst_case_latency_ms": None if worst is None else worst / MS,
                "margin_ms": None if margin is None else margin / MS,
                "meets_deadline": margin is not None and margin >= 0,
            }
        )
    return {
        "bitrate": bitrate,
        "load": load(streams, bitrate),
        "schedulable": all(entry["meets_deadline"] for entry in entries),
        "messages": entries,
    }


def analyse(path: Path, bitrate: int, *, error_interval_ms: float | None = None) -> dict[str, Any]:
    """`report` for a DBC file and a bit rate in bit/s. Raises InputError."""
    if not MIN_BITRATE <= bitrate <= MAX_BITRATE:
        raise InputError(f"bit rate {bitrate}: classical CAN has 10000 to 1000000 bit/s; give --bitrate 500000")
    interval_ns = None if error_interval_ms is None else int(error_interval_ms * MS)
    return report(streams_of_dbc(path), bitrate, error_interval_ns=interval_ns)


def as_text(result: Mapping[str, Any]) -> str:
    """The report as a table for people."""
    lines = [
        f"{result['bitrate']} bit/s, load {100 * result['load']:.1f} % at worst",
        f"{'message':<16}{'id':>6}{'bits':>6}{'period':>9}{'worst':>10}{'deadline':>10}{'margin':>10}   ms",
    ]
    for entry in result["messages"]:
        worst, margin = entry["worst_case_latency_ms"], entry["margin_ms"]
        latency = "for ever" if worst is None else f"{worst:.3f}"
        left = "-" if margin is None else f"{margin:.3f}"
        mark = "*" if entry["period_assumed"] else " "
        missed = "" if entry["meets_deadline"] else "  can be missed"
        lines.append(
            f"{entry['name']:<16}{entry['id']:>#6x}{entry['frame_bits']:>6}{entry['period_ms']:>8.0f}{mark}"
            f"{latency:>10}{entry['deadline_ms']:>10.1f}{left:>10}{missed}"
        )
    lines.append("* an event: the period is assumed; bits and times with worst-case stuffing and intermission")
    return "\n".join(lines)
