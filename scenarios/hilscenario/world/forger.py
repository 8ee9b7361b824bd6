"""Forges authorised commands as well as anybody without the key can."""

from __future__ import annotations

import random
from collections.abc import Mapping

from firmware_sim import frames as layout
from hilbridge.records import Frame
from hilbridge.verbs import VERBS
from hilbridge.wire.codec import Decoded
from hilbridge.wire.dbc import Value
from hilbridge.wire.e2e import protect
from hilscenario.world.parts import codec

_VERB = VERBS[0]


class Forger:
    """Makes ACT_CMD and ACT_AUTH that are right in CRC, counter, session and echo, and wrong in the MAC alone."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(f"{seed}.forger")
        self._counters = {"ACT_CMD": 0, "ACT_AUTH": 0}
        self._session = self._echo = 0
        self._second = 0  # the counter of a second bridge's commands

    def hear(self, can_id: int, data: bytes) -> None:
        """Learn session, echo and counters from the bus, as anybody there can."""
        if len(data) != 8:
            return
        if can_id == layout.CTRL_STATUS:
            self._echo = data[2]
            decoded = codec().decode(Frame(can_id, data))
            if isinstance(decoded, Decoded):
                self._session = int(decoded.signals["Session"])
        elif can_id in (layout.ACT_CMD, layout.ACT_AUTH):
            self._counters["ACT_CMD" if can_id == layout.ACT_CMD else "ACT_AUTH"] = data[2]

    def pair(self) -> list[tuple[int, bytes]]:
        """One forged command with its authorisation."""
        command: dict[str, Value] = {
            "Gate": "Act",
            "Verb": _VERB,
            "Confidence": 99,
            "Session": self._session,
            "Echo": self._echo,
            "SensingAge": 20,
        }
        authorisation = {"Freshness": self._random.getrandbits(8), "Mac": self._random.getrandbits(32)}
        return [self._made("ACT_CMD", command), self._made("ACT_AUTH", authorisation)]

    def second(self) -> list[tuple[int, bytes]]:
        """The command of another bridge, which knows nothing of ours: HOLD, under a counter of its own."""
        ours, self._counters["ACT_CMD"] = self._counters["ACT_CMD"], self._second
        hold: dict[str, Value] = {"Gate": "Hold", "Verb": "None", "Confidence": 0, "Session": 0}
        made = self._made("ACT_CMD", {**hold, "Echo": self._echo, "SensingAge": 20})
        self._second, self._counters["ACT_CMD"] = self._counters["ACT_CMD"], ours
        return [made]

    def _made(self, message: str, signals: Mapping[str, Value]) -> tuple[int, bytes]:
        layout_of = codec().messages[message]
        assert layout_of.data_id is not None
        counter = self._counters[message] = (self._counters[message] + 1) & 0xFF
        return layout_of.can_id, protect(codec().encode(message, signals), layout_of.data_id, counter)
