"""`python -m firmware_sim.c.generate`: write ctl_tables.h, ctl_tables.c and elbow_numbers.h, what the C takes from Python.

States, events, reasons, the transition table, limits, message layout and the curves of the torque law stand in Python
alone, profiles in profiles.toml. A test compares the files with what this module makes. The layout is held to the DBC by
its own test.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import IntEnum
from pathlib import Path
from types import ModuleType

from firmware_sim import e2e, frames, memory, profiles, secoc, states, torque, transitions, transmit, watchdogs
from firmware_sim.law import allowance, damping, filters, guidance, numbers, support
from firmware_sim.law import memory as law_memory
from firmware_sim.plant import actuator, arm

HOME = Path(__file__).parent
_NOTE = "/* Made by `python -m firmware_sim.c.generate` from the Python sources. Do not edit. */\n"
_ENUMS: dict[str, type[IntEnum]] = {
    "STATE": states.State,
    "EVENT": states.Event,
    "REASON": states.Reason,
    "REJECT": frames.Reject,
    "CHECK": e2e.Check,
    "MACHINE": e2e.Machine,
    "REFUSAL": memory.Refusal,
    "GUIDANCE": profiles.Guidance,
}
_MODULES = (
    frames, e2e, memory, watchdogs, transitions, transmit, torque, law_memory, numbers, filters, guidance, damping,
    allowance, support,
)  # fmt: skip
_PROFILES = 32  # one for each value that ACT_CMD's Verb may have
_MOST_FIELDS = max(len(fields) for fields in frames.FIELDS.values())


def _constants(module: ModuleType) -> dict[str, int]:
    """Whole numbers in capitals, the private ones too."""
    found = {name.lstrip("_"): value for name, value in vars(module).items() if name.isupper()}
    return {name: int(value) for name, value in found.items() if type(value) is int}


def _defines() -> list[str]:
    known: dict[str, int] = {}
    for module in _MODULES:
        for name, value in _constants(module).items():
            if known.setdefault(name, value) != value:
                raise ValueError(f"{module.__name__}: {name} has two values, {known[name]} and {value}; rename one")
    return [f"#define CTL_{name} {_number(value)}" for name, value in sorted(known.items())]


def _number(value: int) -> str:
    return f"0x{value:X}U" if value > 0x7FFFFFFF else str(value)


def header() -> str:
    """ctl_tables.h: constants, enumerations, and what ctl_tables.c holds."""
    lines = [_NOTE, "#ifndef CTL_TABLES_H", "#define CTL_TABLES_H", "#include <stdbool.h>", "#include <stdint.h>", ""]
    lines += _defines()
    lines += [f"#define CTL_PROFILES_HASH 0x{profiles.shipped().hash32:08X}U"]
    for prefix, members in _ENUMS.items():
        named = ", ".join(f"CTL_{prefix}_{member.name} = {member.value}" for member in members)
        lines += ["", f"enum {{ {named} }};", f"#define CTL_{prefix}_COUNT {len(members)}"]
    lines += ["", *(f"#define CTL_SLOT_{_name(one)} {slot}" for slot, one in enumerate(frames.RECEIVED_IDS))]
    lines += [f"#define CTL_SLOT_{_name(one)} {slot}" for slot, one in enumerate(frames.OWN_IDS)]
    lines += [
        f"#define CTL_RECEIVED_COUNT {len(frames.RECEIVED_IDS)}",
        f"#define CTL_OWN_COUNT {len(frames.OWN_IDS)}",
        f"#define CTL_MOST_FIELDS {_MOST_FIELDS}",
        f"#define CTL_PROFILE_COUNT {_PROFILES}",
        "",
        "/* A field of a message: raw bits from `start`; `allowed` has a bit for each value of an enumeration. */",
        "typedef struct {",
        "    uint8_t start, bits;",
        "    bool enumerated, multiplexer;",
        "    uint32_t allowed, lowest, highest;",
        "} ctl_field;",
        "typedef struct {",
        "    uint16_t can_id, data_id;",
        "    uint8_t max_delta, field_count;",
        "    uint64_t reserved;",
        "    ctl_field fields[CTL_MOST_FIELDS];",
        "} ctl_message;",
        "typedef struct {",
        "    int32_t " + ", ".join(profiles.Profile._fields) + ";",
        "} ctl_profile;",
        "",
        "extern const uint8_t ctl_transitions[CTL_STATE_COUNT][CTL_EVENT_COUNT];",
        "extern const ctl_message ctl_received[CTL_RECEIVED_COUNT], ctl_own[CTL_OWN_COUNT];",
        "extern const ctl_profile ctl_profiles[CTL_PROFILE_COUNT];",
        "extern const uint16_t ctl_crc_table[256];",
        f"extern const int32_t ctl_remaining[{len(numbers.REMAINING)}], ctl_reached[{len(numbers.REACHED)}];",
        f"extern const int32_t ctl_way[{len(numbers.WAY)}], ctl_sine[{len(numbers.SINE)}];",
        f"extern const uint8_t ctl_session_label[{len(secoc.SESSION_LABEL)}];",
        "",
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def _name(can_id: int) -> str:
    return next(
        name for name, value in vars(frames).items() if name.isupper() and value == can_id and type(value) is int
    )


def _array(kind: str, name: str, values: Iterable[int]) -> str:
    listed = [str(value) for value in values]
    rows = [", ".join(listed[at : at + 16]) for at in range(0, len(listed), 16)]
    return f"const {kind} {name}[{len(listed)}] = {{\n    " + ",\n    ".join(rows) + ",\n};"


def _field(field: frames.Field) -> str:
    allowed = sum(1 << value for value in field.allowed or ())
    if allowed > 0xFFFFFFFF:
        raise ValueError(f"{field.name}: an enumeration above 31 needs a wider `allowed`")
    flags = f"{str(field.allowed is not None).lower()}, {str(field.name in frames.MULTIPLEXERS).lower()}"
    lowest, highest = (value & 0xFFFFFFFF for value in (field.lowest, field.highest))
    return f"{{{field.start}, {field.bits}, {flags}, 0x{allowed:X}U, {lowest}U, {highest}U}}"


def _messages(name: str, can_ids: tuple[int, ...]) -> str:
    rows = []
    for can_id in can_ids:
        fields = frames.FIELDS[can_id]
        if can_id in frames.RECEIVED_IDS and any(field.lowest < 0 for field in fields):
            raise ValueError(f"frame 0x{can_id:03X}: the C reads no signed field; see ctl_unpack")
        numbers_ = f"0x{can_id:03X}, 0x{e2e.DATA_ID[can_id]:04X}, {e2e.MAX_DELTA.get(can_id, 0)}, {len(fields)}"
        body = ",\n      ".join(_field(field) for field in fields)
        rows.append(f"    {{{numbers_}, 0x{frames.RESERVED_MASK[can_id]:X}ULL,\n     {{{body}}}}},")
    return f"const ctl_message {name}[{len(can_ids)}] = {{\n" + "\n".join(rows) + "\n};"


def source() -> str:
    """ctl_tables.c: the tables."""
    table = [[int(states.TABLE[state][event]) for event in states.Event] for state in states.State]
    rows = "\n".join(f"    {{{', '.join(map(str, row))}}}," for row in table)
    verbs = "\n".join(
        f"    {{{', '.join(str(int(value)) for value in one)}}}," for one in map(profiles.profile, range(_PROFILES))
    )
    parts = [
        _NOTE,
        '#include "ctl_tables.h"\n',
        f"const uint8_t ctl_transitions[CTL_STATE_COUNT][CTL_EVENT_COUNT] = {{\n{rows}\n}};",
        _messages("ctl_received", frames.RECEIVED_IDS),
        _messages("ctl_own", frames.OWN_IDS),
        f"const ctl_profile ctl_profiles[CTL_PROFILE_COUNT] = {{\n{verbs}\n}};",
        _array("uint16_t", "ctl_crc_table", e2e.CRC_TABLE),
        _array("int32_t", "ctl_remaining", numbers.REMAINING),
        _array("int32_t", "ctl_reached", numbers.REACHED),
        _array("int32_t", "ctl_way", numbers.WAY),
        _array("int32_t", "ctl_sine", numbers.SINE),
        _array("uint8_t", "ctl_session_label", secoc.SESSION_LABEL),
    ]
    return "\n".join(parts) + "\n"


def plant() -> str:
    """elbow_numbers.h: the simulated arm and motor, exact to the last bit."""
    found = {
        **_reals(arm),
        "LIMIT_NM": actuator.LIMIT_NM,
        "PI": math.pi,
        "RADIANS": math.radians(1.0),
    }
    found["STILL_AT"] = found.pop("STILL")
    lines = [f"#define ELBOW_{name} {value.hex()} /* {value!r} */" for name, value in found.items()]
    lines += [f"#define ELBOW_{name.upper()} {place}" for place, name in enumerate(arm.WEARERS)]
    return "\n".join([_NOTE, "#ifndef ELBOW_NUMBERS_H", "#define ELBOW_NUMBERS_H", "", *lines, "", "#endif"]) + "\n"


def _reals(module: ModuleType) -> dict[str, float]:
    """What is written in capitals and is no whole number."""
    return {name.lstrip("_"): value for name, value in vars(module).items() if name.isupper() and type(value) is float}


def made() -> dict[Path, str]:
    """Every file and what belongs into it."""
    return {HOME / "ctl_tables.h": header(), HOME / "ctl_tables.c": source(), HOME / "elbow_numbers.h": plant()}


if __name__ == "__main__":
    for path, text in made().items():
        path.write_text(text)
