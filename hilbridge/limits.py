"""The numbers of the contract on the bridge's side: periods, limits, waits and repeats (docs/protocol.md).

The device has its own in `firmware_sim/watchdogs.py` and shares no code with the bridge; tests/test_limits.py compares
the two. All of them are constants: no configuration loosens one.
"""

from __future__ import annotations

MS = 1_000_000  # nanoseconds

PROTOCOL_VERSION = 1

# The bridge's own rhythm.
TICK_NS = 40 * MS  # one ACT_CMD each
OVERRUN_NS = 2 * TICK_NS  # a tick a whole period late says what was decided for another moment: it holds
TICK_GRACE_NS = 24 * MS  # a tick locked to the camera may wait this long for its picture: at most 64 ms between two
HEARTBEAT_NS = 100 * MS  # at most: on the grid of the ticks that is every second one, 80 ms
STOP_REPEATS = 3
STOP_GAP_NS = 10 * MS

# What the bridge asks of the device.
STATUS_LIMIT_NS = 60 * MS  # three CTRL_STATUS
CHALLENGE_WAIT_NS = 300 * MS
# The device publishes its MAC failures once a second: before trying again, find out whether the key was at fault. A
# third failure would latch it.
CONFIRM_WAIT_NS = 1_200 * MS
# A challenge so soon after somebody else's ARM_REQUEST may be the answer to that one: it is not answered.
STRANGER_NS = 50 * MS
FRESHNESS_LIMIT = 0xFFFFFFFF

# What sensing must be for an ACT. The contract's age also bounds what a site may set (hilbridge.config).
SENSING_LIMIT_MS = 150
SENSING_LIMIT_NS = SENSING_LIMIT_MS * MS
AGE_STEP_MS = 2  # resolution of ACT_CMD.SensingAge
AGE_UNKNOWN_MS = 510  # what an age that is unknown, or longer, is sent as
SENSOR_TIMEOUT_MS = 120  # a source silent for longer has failed
FREEZE_LIMIT_MS = 150  # a camera that shows the same picture for longer has failed
FREEZE_LIMIT_MAX_MS = 500
GAP_NS = 150 * MS  # after a longer gap between two feature vectors, belief starts anew
GAZE_COAST_NS = 100 * MS  # a blink
HAND_COAST_NS = 160 * MS  # four pictures without the hand

REFRACTORY_MS = 240  # between two switches of the gate that confidence drives
STALE_COMMAND_NS = 20 * MS  # a command half its cycle old is worth less than the next one: never sent
# After any gap in sensing, ACT waits until sensing was whole for so long without a break, however sure the gate is.
EARN_NS = 400 * MS
