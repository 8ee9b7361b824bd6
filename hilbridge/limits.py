"""The numbers of the contract on the bridge's side. All of them are constants: no configuration loosens one."""

from __future__ import annotations

MS = 1_000_000  # nanoseconds

# After any gap in sensing, ACT waits until sensing was whole for so long without a break, however sure the gate is.
EARN_NS = 400 * MS
