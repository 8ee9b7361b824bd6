"""A deadline: something that has to keep arriving. Pure; time is an argument (monotonic ns)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Deadline:
    """Expires when `limit_ns` have gone by since it was last fed; one that was never fed has expired."""

    limit_ns: int
    fed_ns: int | None = None

    def fed(self, now_ns: int) -> Deadline:
        """The same deadline, fed now."""
        return Deadline(self.limit_ns, now_ns)

    def expired(self, now_ns: int) -> bool:
        """Whether the limit is reached or past."""
        return self.fed_ns is None or now_ns - self.fed_ns >= self.limit_ns
