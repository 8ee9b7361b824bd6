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
from itertools import pairwise
from pathlib import Path
from typing import Any

from hilbridge.bus.message_set import Stream, read_message_set
from hilbridge.bus.model.bits import INTERMISSION_BITS, frame_length
from hilbridge.bus.model.frames import WireFrame
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.wire.dbc_file import shown_id

NS_PER_S = 1_000_000_000
MIN_BITRATE, MAX_BITRATE = 10_000, 1_000_000
MAX_DATA_BITRATE = 8_000_000
_ERROR_FRAME_BITS = 31  # error flag, superposition, delimiter, intermission (Tindell 1995)


@dataclass(frozen=True, slots=True)
class Response:
    """A stream's worst case from queueing to the end of its frame (intermission included); None: it may wait for ever."""

    stream: Stream
    worst_ns: int | None

    @property
    def margin_ns(self) -> int | None:
        """Time left to the deadline; negative where it can be missed."""
        return None if self.worst_ns is None else self.stream.deadline_ns - self.worst_ns


def exact_frame_bits(frame: WireFrame) -> int:
    """Bits of one classical frame as it is, with intermission."""
    return frame_length(frame).nominal_bits + INTERMISSION_BITS


@dataclass(frozen=True, slots=True)
class Rates:
    """Bit rates of a bus in bit/s; without a data bit rate FD frames are sent at the arbitration bit rate throughout."""

    nominal: int
    data: int | None = None

    def duration_ns(self, stream: Stream) -> int:
        """How long the stream's longest frame takes, intermission included."""
        nominal_ns = stream.frame_bits * NS_PER_S // self.nominal
        return nominal_ns + stream.data_bits * NS_PER_S // (self.data or self.nominal)


def load(streams: Sequence[Stream], bitrate: int, *, data_bitrate: int | None = None) -> float:
    """The share of time the bus is in use when every stream is as frequent and as long as it can be."""
    rates = Rates(bitrate, data_bitrate)
    return sum(rates.duration_ns(stream) / stream.period_ns for stream in streams)


def responses(
    streams: Sequence[Stream], bitrate: int, *, data_bitrate: int | None = None, error_interval_ns: int | None = None
) -> list[Response]:
    """The worst case of each stream, most urgent first. `error_interval_ns`: one error frame in each such interval.

    Raises InputError where two streams have the same arbitration field.
    """
    ordered = sorted(streams, key=lambda stream: stream.key)
    for one, other in pairwise(ordered):
        if one.key == other.key:
            raise InputError(
                f"messages {one.name} and {other.name} have one identifier {one.can_id:#05x}; "
                "on a bus they would destroy each other: change the DBC"
            )
    rates = Rates(bitrate, data_bitrate)
    return [
        Response(stream, _worst_ns(ordered, index, rates, error_interval_ns)) for index, stream in enumerate(ordered)
    ]


def _ceil(numerator: int, denominator: int) -> int:
    return -(-numerator // denominator)


def _worst_ns(ordered: Sequence[Stream], index: int, rates: Rates, error_interval_ns: int | None) -> int | None:
    bit_ns, duration = NS_PER_S // rates.nominal, rates.duration_ns
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
    """The least fixed point reached from `start`; None where it exceeds a minute, which no usable bus does."""
    value = start
    while value < 60 * NS_PER_S:
        following = step(value)
        if following == value:
            return value
        value = following
    return None


def with_exact_bits(streams: Sequence[Stream], frames: Mapping[int, WireFrame]) -> list[Stream]:
    """The same set with the true length of given frames (by identifier) in place of the bound."""
    return [
        replace(stream, frame_bits=exact_frame_bits(frames[stream.can_id]))
        if stream.can_id in frames and frames[stream.can_id].is_extended == stream.is_extended
        else stream
        for stream in streams
    ]


def report(
    streams: Sequence[Stream], bitrate: int, *, data_bitrate: int | None = None, error_interval_ns: int | None = None
) -> dict[str, Any]:
    """Load and worst cases in plain values, as `hilbridge bus-analysis --json` prints them; times in milliseconds."""
    found = responses(streams, bitrate, data_bitrate=data_bitrate, error_interval_ns=error_interval_ns)
    entries = []
    for response in found:
        stream, worst, margin = response.stream, response.worst_ns, response.margin_ns
        entries.append(
            {
                "name": stream.name,
                "id": stream.can_id,
                "extended": stream.is_extended,
                "fd": stream.is_fd,
                "payload_bytes": stream.payload_bytes,
                "frame_bits": stream.frame_bits + stream.data_bits,
                "data_bits": stream.data_bits,
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
        "data_bitrate": data_bitrate,
        "load": load(streams, bitrate, data_bitrate=data_bitrate),
        "schedulable": all(entry["meets_deadline"] for entry in entries),
        "messages": entries,
        "left_out": {},
    }


def analyse(
    path: Path, bitrate: int, *, data_bitrate: int | None = None, error_interval_ms: float | None = None
) -> dict[str, Any]:
    """`report` for a DBC file and bit rates in bit/s; the data bit rate of CAN FD is the DBC's (BaudrateCANFD) where none
    is given. Raises InputError.
    """
    if not MIN_BITRATE <= bitrate <= MAX_BITRATE:
        raise InputError(f"bit rate {bitrate}: classical CAN has 10000 to 1000000 bit/s; give --bitrate 500000")
    if data_bitrate is not None and not bitrate <= data_bitrate <= MAX_DATA_BITRATE:
        raise InputError(
            f"data bit rate {data_bitrate}: CAN FD has {bitrate} to {MAX_DATA_BITRATE} bit/s; give --data-bitrate 2000000"
        )
    interval_ns = None if error_interval_ms is None else int(error_interval_ms * MS)
    found = read_message_set(path)
    rate = data_bitrate
    if rate is None and found.data_bitrate is not None and bitrate <= found.data_bitrate <= MAX_DATA_BITRATE:
        rate = found.data_bitrate
    result = report(found.streams, bitrate, data_bitrate=rate, error_interval_ns=interval_ns)
    return {**result, "left_out": found.left_out}


def as_text(result: Mapping[str, Any]) -> str:
    """The report as a table for people."""
    fd_names = [entry["name"] for entry in result["messages"] if entry["data_bits"]]
    rate = result["data_bitrate"]
    wide = max([16, *(len(entry["name"]) + 1 for entry in result["messages"])])
    with_data = f", data {rate} bit/s" if fd_names and rate else ""
    lines = [
        f"{result['bitrate']} bit/s{with_data}, load {100 * result['load']:.1f} % at worst",
        f"{'message':<{wide}}{'id':>10}{'bits':>6}{'period':>9}{'worst':>10}{'deadline':>10}{'margin':>10}   ms",
    ]
    for entry in result["messages"]:
        worst, margin = entry["worst_case_latency_ms"], entry["margin_ms"]
        latency = "for ever" if worst is None else f"{worst:.3f}"
        left = "-" if margin is None else f"{margin:.3f}"
        mark = "*" if entry["period_assumed"] else " "
        missed = "" if entry["meets_deadline"] else "  can be missed"
        shown = shown_id(entry["id"], is_extended=entry["extended"])
        lines.append(
            f"{entry['name']:<{wide}}{shown:>10}{entry['frame_bits']:>6}{entry['period_ms']:>8.0f}{mark}"
            f"{latency:>10}{entry['deadline_ms']:>10.1f}{left:>10}{missed}"
        )
    lines.append("* an event: the period is assumed; bits and times with worst-case stuffing and intermission")
    if fd_names and not rate:
        some = ", ".join(fd_names[:4]) + (" ..." if len(fd_names) > 4 else "")
        lines.append(
            f"CAN FD ({len(fd_names)}: {some}): counted at {result['bitrate']} bit/s throughout, the longest they can "
            "take; give --data-bitrate"
        )
    lines += [f"left out: {name}, {why}" for name, why in result["left_out"].items()]
    return "\n".join(lines)
