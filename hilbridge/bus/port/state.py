"""What a port says of itself: what became of a frame, what was counted, how the bus is."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum

from hilbridge.bus.model.error_frames import ErrorState


class SendResult(StrEnum):
    """What became of `BusPort.send`."""

    SENT = "sent"
    QUEUED = "queued"  # the interface is full: tried again for 20 ms at most
    FULL = "full"
    DOWN = "down"
    LISTEN_ONLY = "listen_only"
    REFUSED = "refused"
    CLOSED = "closed"


@dataclass(slots=True)
class PortCounters:
    """Everything that passed or was lost, by reason, since the port was opened."""

    received: int = 0
    received_errors: int = 0
    sent: int = 0
    retried: int = 0
    dropped_full: int = 0
    dropped_stale: int = 0
    dropped_superseded: int = 0
    dropped_down: int = 0
    dropped_listen_only: int = 0
    dropped_refused: int = 0
    overflow_kernel: int = 0
    overflow_port: int = 0
    link_downs: int = 0
    link_ups: int = 0

    def as_dict(self) -> dict[str, int]:
        """All counters by name."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class PortState:
    """The bus as the port sees it; `reason` says why the link is down, `changed_ns` since when all this holds."""

    link_up: bool
    controller: ErrorState
    tx_errors: int | None
    rx_errors: int | None
    reason: str
    changed_ns: int
