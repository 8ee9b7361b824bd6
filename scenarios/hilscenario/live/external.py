"""A device under test that speaks on the bus by itself: heard, reset by its user's command, its arm run beside it if asked."""

from __future__ import annotations

import shlex
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from firmware_sim.attachment import Attachment, parse_spec
from firmware_sim.frames import OWN_IDS, STOP
from hilbridge.bus.port.spec import BusSpec
from hilbridge.errors import InputError
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec
from hilbridge.wire.keys import load_key
from hilscenario.live.witness import Witness

STATUS, LATCHED = 0x0A0, 7  # CTRL_STATUS, and the states from which on a device is stopped
_OURS = frozenset({0x060, 0x061, 0x120, 0x180, 0x182, 0x300})
_KNOWN = _OURS | {STOP, *OWN_IDS}
_ALONE = "Take everybody but the device off the bus"
_PLANT_S = 20.0


class External(NamedTuple):
    """What `--device external` was given: the plant bus to run an arm on, and what resets the device, if any; and, for a
    physical bus, that nobody wears the device, and the key that it has.
    """

    plant_bus: str | None = None
    reset_command: str | None = None
    on_a_bench: bool = False
    key_file: Path | None = None


def external_device(
    device: str,
    plant_bus: str | None,
    reset_command: str | None = None,
    *,
    live: bool,
    on_a_bench: bool = False,
    key_file: Path | None = None,
) -> External | None:
    """What `--device` and what goes with it ask for; None is the simulated device. Raises InputError."""
    if device not in ("simulated", "external"):
        raise InputError(f"--device {device}: there are simulated and external")
    if device == "simulated":
        asked = {
            "--plant-bus": plant_bus,
            "--reset-command": reset_command,
            "--i-am-on-a-bench": on_a_bench or None,
            "--key-file": key_file,
        }
        given = next((option for option, value in asked.items() if value is not None), None)
        if given is not None:
            raise InputError(f"{given}: is for a device of yours; add --device external, or leave it out")
        return None
    if not live:
        raise InputError("--device external: virtual time has no device of yours; add --live --bus BUS")
    return External(plant_bus, reset_command, on_a_bench, key_file)


def refuse_key(spec: BusSpec, external: External) -> None:
    """Raises InputError for a key that may not be used on this bus: the demo key on a physical one."""
    load_key(external.key_file, physical=parse_spec(str(spec)).physical)


class HeardRows:
    """Stands in for the growing log of a simulated device."""

    def __init__(self, bus: Attachment, witness: Witness) -> None:
        self._bus, self._witness = bus, witness
        self._watched = bus.spec.physical
        self.more: list[dict[str, Any]] = []

    def new(self) -> list[dict[str, Any]]:
        """Lines of what was heard since. Raises InputError for an unknown node on a physical bus."""
        lines, self.more = self.more, []
        for arrival in self._bus.read(time.monotonic_ns()):
            frame = arrival.frame
            if self._watched and frame.can_id not in _KNOWN:
                raise InputError(f"bus: an unknown node sends {frame.can_id:#05x}; the run has ended. {_ALONE}")
            kind = {} if frame.plain else {"is_remote": True}
            lines += self._witness.take(Frame(frame.can_id, frame.data, arrival.arrived_ns, **kind))
        return lines

    def close(self) -> None:
        """Leave the bus."""
        self._bus.close()


class ExternalDevice:
    """In the place of a DeviceHandle. It is never started or ended; only its arm is."""

    name = "plant"

    def __init__(self, spec: BusSpec, asked: External, arm: str, reset_command: str | None, folder: Path) -> None:
        self._witness = Witness(Codec())
        self._spec = spec
        self._bus = Attachment(parse_spec(str(spec)))
        self.rows = HeardRows(self._bus, self._witness)
        self._reset_command = reset_command
        self._said = folder / "plant.out"
        self._on_a_bench = asked.on_a_bench
        self._plant = None if asked.plant_bus is None else self._start(asked.plant_bus, arm)

    def _start(self, plant_bus: str, arm: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "firmware_sim.bench.process", "--bus", plant_bus, "--wearer-torque", arm]
        command += ["--i-am-on-a-bench"] if self._on_a_bench else []
        with self._said.open("wb") as said:
            plant = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=said, stderr=said)
        end_s = time.monotonic() + _PLANT_S
        while b"plant ready" not in (told := self._said.read_bytes()):
            if plant.poll() is not None or time.monotonic() > end_s:
                plant.kill()
                lines = told.decode(errors="replace").strip().splitlines()
                raise InputError(f"the plant did not start: {lines[-1] if lines else 'it said nothing'}")
            time.sleep(0.02)
        return plant

    @property
    def alive(self) -> bool:
        return self._plant is None or self._plant.poll() is None

    @property
    def exit_code(self) -> int | None:
        return None if self._plant is None else self._plant.returncode

    def command(self, text: str) -> None:
        """`restart` is its user's command; nothing else can be told to a device of somebody's own."""
        if text != "restart" or self._reset_command is None:
            return
        reset(self._reset_command)
        self.rows.more.append({"command": "restart", "ends_ns": time.monotonic_ns()})

    def end(self) -> None:
        """End the arm."""
        if self._plant is not None:
            self._plant.terminate()
            try:
                self._plant.wait(5.0)
            except subprocess.TimeoutExpired:
                self._plant.kill()

    def summary(self) -> dict[str, Any]:
        """What the bus told."""
        return self._witness.summary()


def reset(command: str) -> None:
    """Run the user's command that resets the device. Raises InputError."""
    try:
        subprocess.run(shlex.split(command), check=True, stdin=subprocess.DEVNULL, capture_output=True, timeout=10.0)
    except (OSError, ValueError, IndexError, subprocess.SubprocessError) as error:
        said = " ".join(str(error).split())
        raise InputError(f"reset command {command!r}: {said}; give one that resets the device") from None


def refuse_silence(spec: BusSpec, heard: Mapping[int, bytes]) -> None:
    """Raises InputError unless a device that is not stopped, and no bridge, is heard: identifier -> its last data.

    On a physical bus nobody else may be heard at all.
    """
    if bridge := heard.keys() & _OURS:
        raise InputError(f"bus {spec}: a bridge is on it already ({min(bridge):#05x}); end it, or use another bus")
    strangers = sorted(heard.keys() - set(OWN_IDS)) if parse_spec(str(spec)).physical else []
    if strangers:
        named = ", ".join(f"{can_id:#05x}" for can_id in strangers[:4])
        raise InputError(f"bus {spec}: an unknown node sends {named}. {_ALONE}")
    if STATUS not in heard:
        raise InputError(
            f"bus {spec}: no device under test is heard (no CTRL_STATUS in 0.6 s); start it, check wires and bit rate"
        )
    if len(heard[STATUS]) == 8 and heard[STATUS][3] & 0xF >= LATCHED:
        raise InputError(
            f"bus {spec}: the device under test is latched or stopped; clear it, or give --reset-command, which is run "
            "before each scenario"
        )
