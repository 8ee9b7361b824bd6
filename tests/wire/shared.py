"""What the tests of this room share."""

from __future__ import annotations

from typing import Any

from hilbridge.records import Frame
from hilbridge.wire.codec import Codec
from hilbridge.wire.link import WireLink

CODEC = Codec()


def status(link: WireLink, **signals: Any) -> Frame:
    """The link's next CTRL_STATUS."""
    return link.encode("CTRL_STATUS", signals)
