"""What a client may ask the owner of a simulated bus: one strict, bounded message type per request, JSON on the link.

Whatever a stranger sends is either one of these or a reason why it is none; nothing else reaches the model of the bus.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from hilbridge.bus.model.faults import FOREVER_NS, Babble, Corruption, QueueStall, Where, WireCut, WireFaults
from hilbridge.bus.model.frames import EXTENDED_ID_MAX, STANDARD_ID_MAX

REQUEST_LIMIT_BYTES = 1 << 14  # cuts of every node by name are the longest that anybody needs
_ENTRIES = 16  # of each kind of fault: the model looks at all of them for every frame
_REASON_LIMIT = 200
_MISTAKES = 20

Name = Annotated[str, Field(min_length=1, max_length=64)]
Names = Annotated[tuple[Name, ...], Field(max_length=256)]
_TIME_LIMIT_MS = 1e12  # thirty years
Time = Annotated[float, Field(ge=-_TIME_LIMIT_MS, le=_TIME_LIMIT_MS)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class _Message(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class _Timed(_Message):
    """Times count from the moment of the request."""

    from_ms: Time | None = None
    until_ms: Time | None = None

    def _span(self, now_ns: int) -> tuple[int, int]:
        from_ns = 0 if self.from_ms is None else now_ns + int(self.from_ms * 1e6)
        return from_ns, FOREVER_NS if self.until_ms is None else now_ns + int(self.until_ms * 1e6)


class CorruptionEntry(_Timed):
    """One bit of some frames turned over."""

    can_id: Annotated[int, Field(ge=0, le=EXTENDED_ID_MAX)] | None
    bit: Where | Annotated[int, Field(ge=-1024, le=1024)] = Where.DATA
    receiver: Name | None = None
    count: Annotated[int, Field(ge=0, le=1_000_000_000)] = 1

    def at(self, now_ns: int) -> Corruption:
        """In the model's own words."""
        return Corruption(self.can_id, self.bit, self.receiver, self.count, *self._span(now_ns))


class BabbleEntry(_Timed):
    """A node that fills the bus."""

    node: Name
    can_id: Annotated[int, Field(ge=0, le=STANDARD_ID_MAX)] = 0
    data: Annotated[str, Field(pattern=r"\A(?:[0-9A-Fa-f]{2}){0,8}\z")] = "55" * 8

    def at(self, now_ns: int) -> Babble:
        """In the model's own words."""
        return Babble(self.node, self.can_id, bytes.fromhex(self.data), *self._span(now_ns))


class CutEntry(_Timed):
    """Nodes off the wire."""

    nodes: Names

    def at(self, now_ns: int) -> WireCut:
        """In the model's own words."""
        return WireCut(frozenset(self.nodes), *self._span(now_ns))


class StallEntry(_Timed):
    """A node whose frames wait."""

    node: Name

    def at(self, now_ns: int) -> QueueStall:
        """In the model's own words."""
        return QueueStall(self.node, *self._span(now_ns))


class FaultsEntry(_Message):
    """All faults of the wire at once; they replace those before."""

    seed: Annotated[int, Field(ge=-(1 << 63), lt=1 << 64)] = 0
    bit_error_rate: Share = 0.0
    local_share: Share = 0.0
    corruptions: Annotated[tuple[CorruptionEntry, ...], Field(max_length=_ENTRIES)] = ()
    babbles: Annotated[tuple[BabbleEntry, ...], Field(max_length=_ENTRIES)] = ()
    cuts: Annotated[tuple[CutEntry, ...], Field(max_length=_ENTRIES)] = ()
    stalls: Annotated[tuple[StallEntry, ...], Field(max_length=_ENTRIES)] = ()
    no_ack: Names = ()

    def at(self, now_ns: int) -> WireFaults:
        """In the model's own words."""
        return WireFaults(
            self.seed,
            self.bit_error_rate,
            self.local_share,
            tuple(entry.at(now_ns) for entry in self.corruptions),
            tuple(entry.at(now_ns) for entry in self.babbles),
            tuple(entry.at(now_ns) for entry in self.cuts),
            tuple(entry.at(now_ns) for entry in self.stalls),
            frozenset(self.no_ack),
        )


class StatusRequest(_Message):
    """The bus in plain values."""

    op: Literal["status"]


class RecoverRequest(_Message):
    """Leave bus-off."""

    op: Literal["recover"]


class FaultsRequest(_Message):
    """Exchange the faults of the wire."""

    op: Literal["faults"]
    faults: FaultsEntry


Request = StatusRequest | RecoverRequest | FaultsRequest
_ANY: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="op")])


def read_request(raw: bytes) -> Request | str:
    """The request, or in one short line why there is none. Never raises."""
    if len(raw) > REQUEST_LIMIT_BYTES:
        return f"a request has at most {REQUEST_LIMIT_BYTES} bytes"
    try:
        return _ANY.validate_json(raw)
    except ValidationError as error:
        if error.error_count() > _MISTAKES:  # to describe thousands takes longer than a frame
            return f"{error.error_count()} mistakes in one request"
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        return f"{where}: {first['msg']}"[:_REASON_LIMIT] if where else str(first["msg"])[:_REASON_LIMIT]
