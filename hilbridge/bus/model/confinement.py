"""Fault confinement of one CAN node: the two error counters and what follows from them (ISO 11898-1:2015, 12.1.4)."""

from __future__ import annotations

from hilbridge.bus.model.error_frames import ErrorState

WARNING_LIMIT = 96
PASSIVE_LIMIT = 128
BUS_OFF_LIMIT = 256
RECOVERY_SEQUENCES = 128  # of eleven recessive bits each
RECOVERY_SEQUENCE_BITS = 11
# A successful reception above the passive limit sets REC to a value between 119 and 127; many take this one.
REC_AFTER_PASSIVE = 119


class Confinement:
    """TEC, REC and state of one node. Every method names the rule of the standard it carries out."""

    __slots__ = ("rec", "recovering", "sequences_left", "tec")

    def __init__(self) -> None:
        self.tec = 0
        self.rec = 0
        self.recovering = False
        self.sequences_left = 0

    @property
    def state(self) -> ErrorState:
        """Error confinement state, with the customary warning."""
        if self.sequences_left or self.tec >= BUS_OFF_LIMIT:
            return ErrorState.BUS_OFF
        highest = max(self.tec, self.rec)
        if highest >= PASSIVE_LIMIT:
            return ErrorState.PASSIVE
        return ErrorState.WARNING if highest >= WARNING_LIMIT else ErrorState.ACTIVE

    @property
    def is_passive(self) -> bool:
        """Sends passive error flags and waits eight bits after its own frames."""
        return self.tec >= PASSIVE_LIMIT or self.rec >= PASSIVE_LIMIT

    @property
    def is_bus_off(self) -> bool:
        """Takes no part in the bus, not even an acknowledgement."""
        return self.sequences_left > 0

    def transmitted(self) -> None:
        """Rule g: a frame went through."""
        self.tec = max(0, self.tec - 1)

    def received(self) -> None:
        """Rule h: a frame was received and acknowledged without error."""
        self.rec = REC_AFTER_PASSIVE if self.rec >= PASSIVE_LIMIT else max(0, self.rec - 1)

    def transmit_error(self, *, unacknowledged: bool = False) -> None:
        """Rule c: +8 when a transmitter sends an error flag. Exception 1: not while passive for a missing ACK."""
        if unacknowledged and self.is_passive:
            return
        self.tec += 8
        if self.tec >= BUS_OFF_LIMIT:
            self.sequences_left = RECOVERY_SEQUENCES

    def receive_error(self, *, dominant_after_flag: bool) -> None:
        """Rule a: +1 when a receiver detects an error; rule b: +8 more when its own flag was the first to end.

        The counter stops growing once passive, as controllers with eight bits do; its value above 127 changes nothing.
        """
        self.rec = min(255, self.rec + (9 if dominant_after_flag else 1))

    def recessive_sequences(self, count: int) -> bool:
        """Rule for recovery: `count` more sequences of eleven recessive bits were seen. True when the node is back."""
        if not self.recovering or not self.sequences_left:
            return False
        self.sequences_left = max(0, self.sequences_left - count)
        if self.sequences_left:
            return False
        self.tec = self.rec = 0
        self.recovering = False
        return True
