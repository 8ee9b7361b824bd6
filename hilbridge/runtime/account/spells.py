"""Times in which something is wrong, told once when they begin and once when they are over. Pure."""

from __future__ import annotations

NS_PER_S = 1_000_000_000
# What comes back sooner belongs to the same spell: a camera that drops every other picture is one trouble, not ten a second.
QUIET_NS = NS_PER_S


class Spell:
    """One subject. `look` at it as often as you like; it answers when there is something to say."""

    def __init__(self, quiet_ns: int = QUIET_NS) -> None:
        self._quiet_ns = quiet_ns
        self._since_ns: int | None = None
        self._well_ns: int | None = None
        self._named: list[str] = []

    def look(self, trouble: str | None, now_ns: int) -> str | None:
        """What to tell now: a trouble not yet named in this spell, or that the spell is over, and how long it was."""
        if trouble is not None:
            self._well_ns = None
            if self._since_ns is None:
                self._since_ns = now_ns
            if trouble in self._named:
                return None
            self._named.append(trouble)
            return trouble
        if self._since_ns is None:
            return None
        if self._well_ns is None:
            self._well_ns = now_ns
        if now_ns - self._well_ns < self._quiet_ns:
            return None
        lasted_s = (self._well_ns - self._since_ns) / NS_PER_S
        text = f"over after {lasted_s:.2f} s: {', '.join(self._named)}"
        self._since_ns, self._well_ns, self._named = None, None, []
        return text
