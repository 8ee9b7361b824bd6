"""Who may be tested: never a bus that a person may hang on, and nobody who is not there. Pure; each refusal is one line."""

from __future__ import annotations

from collections.abc import Sequence

from hilbridge.bus.diagnosis import BusFinding, Observation, Severity
from hilbridge.conformance.hearing import Hearing
from hilbridge.errors import InputError
from hilbridge.intent.provenance import Origin
from hilbridge.limits import PROTOCOL_VERSION
from hilbridge.wire.codec import Codec

_SHARE = 0.5  # of unsound frames, from which on it is no noise


def admit_bus(spec: str, *, physical: bool, on_a_bench: bool, origin: Origin | None) -> None:
    """Raises InputError for a physical bus, unless it is a bench and nothing says otherwise. origin: of the bundle."""
    if not physical:
        return
    if not on_a_bench:
        raise InputError(
            f"bus {spec}: may reach a device that somebody wears, and this test forges, stops and latches; take the device "
            "off, then say --i-am-on-a-bench"
        )
    if origin is not Origin.SIMULATED:
        raise InputError(
            f"bus {spec}: the bundle is of {origin or 'unknown origin'}, and only one of simulated people is for a bench; "
            "leave --bundle and model.bundle out"
        )


def admit_company(seen: Observation, findings: Sequence[BusFinding], codec: Codec, *, physical: bool) -> None:
    """Raises InputError unless one device, of this DBC and version, is heard and nobody else.

    Of what is not well with the bus, the first is said with its cure.
    """
    ill = next((finding for finding in findings if finding.severity is Severity.ILL), None)
    if ill is not None:
        raise InputError(f"bus {seen.spec}: {ill.text}; {ill.cure}")
    hearing = Hearing(codec)
    for frame in seen.frames:
        hearing.take(frame)
    strangers = sorted(hearing.strangers)
    ours = [name for name in strangers if name in codec.messages]
    if ours or (physical and strangers):
        raise InputError(
            f"bus {seen.spec}: an unknown node sends {', '.join(strangers[:4])}; take everybody but the device off the bus"
        )
    if not hearing.log and not hearing.unsound:
        raise InputError(
            f"bus {seen.spec}: no device is heard in {seen.seconds:.1f} s; switch it on, check wires, ground and bit rate "
            "(`hilbridge doctor --bus` looks closer)"
        )
    if len(hearing.unsound) > _SHARE * len(seen.frames):
        raise InputError(
            f"bus {seen.spec}: {len(hearing.unsound)} of {len(seen.frames)} frames do not fit the DBC ({hearing.unsound[0]}); "
            f"give both ends one DBC and one version of it (here {codec.path.name})"
        )
    heartbeat = hearing.newest.get("CTRL_HB")
    if heartbeat is not None and heartbeat.signals["ProtocolVersion"] != PROTOCOL_VERSION:
        raise InputError(
            f"bus {seen.spec}: the device speaks version {heartbeat.signals['ProtocolVersion']} of the protocol, this is "
            f"{PROTOCOL_VERSION}; flash a firmware of this version"
        )
