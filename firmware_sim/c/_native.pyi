"""What native.c offers."""

from firmware_sim.law.memory import Torque
from firmware_sim.memory import Inputs, Refusal
from firmware_sim.states import Reason, State
from firmware_sim.watchdogs import Limits

DIGEST: str
PLAIN: str
LAW: str
PROFILES_HASH: int

class Controller:
    def __init__(self, shared_key: bytes, boot_nonce: int, limits: Limits = ...) -> None: ...
    def advance(self, inputs: Inputs, now_ms: int, /) -> None: ...
    def coast(
        self,
        times: tuple[int, int, int],
        elbow: tuple[int, float, float, float, float, float, float, float, int, int],
        self_test_ok: bool,
        bus_off: bool,
        peak_assist_unm: int,
        /,
    ) -> tuple[int, float, int, int, tuple[float, ...]]: ...
    def dump(self) -> tuple[int, ...]: ...
    def load(self, numbers: tuple[int, ...], /) -> None: ...
    def differs(self, numbers: tuple[int, ...], /) -> int: ...
    def machine(self, slot: int, /) -> int: ...
    boot_nonce: int
    last_tick_ms: int
    state: State
    reason: Reason
    refusal: Refusal
    torque: Torque
    verb: int
    command_live: bool
    command_ms: int
    command_is_hold: bool
    accepted_counter: int
    armed: bool
    session: int
    clear_until_ms: int
    emergencies: int
    follow_unm: int
    trips: tuple[int, ...]
    counters: tuple[int, ...]
    outbox: tuple[tuple[int, bytes], ...]

def use_members(states: tuple[State, ...], reasons: tuple[Reason, ...], refusals: tuple[Refusal, ...], /) -> None: ...
def cmac(key: bytes, message: bytes, /) -> bytes: ...
def aes128(key: bytes, block: bytes, /) -> bytes: ...
