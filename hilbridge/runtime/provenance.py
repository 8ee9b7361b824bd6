"""Where a recording comes from: the rows that it begins with. Keys are no part of them."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
import time
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import hilbridge
from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.config import Config
from hilbridge.rows import BundleRow, ConfigRow, HostRow, MetaRow, Row
from hilbridge.runtime.assemble import Parts

_SECRET = ("key", "token", "secret", "password", "passwd")
GIVEN = "given, not recorded"
_GIT_S = 5.0


def first_rows(config: Config, parts: Parts, port: BusPort, title: str, now_ns: int) -> tuple[Row, ...]:
    """What a live recording begins with."""
    meta = MetaRow(
        now_ns,
        title=title,
        bus=str(port.spec),
        physical=port.is_physical,
        listen_only=port.listen_only,
        bundle_id=f"{parts.bundle.bundle_id:#06x}",
        tau_on=parts.gate.tau_on,
        tau_off=parts.gate.tau_off,
        camera=config.sensors.camera,
        gaze=config.sensors.gaze,
        participant=config.recording.participant,
        wall_minus_monotonic_ns=time.time_ns() - time.monotonic_ns(),
        version=hilbridge.__version__,
        revision=revision(),
    )
    return meta, _host_row(now_ns), config_row(config.model_dump(mode="json"), parts, now_ns), bundle_row(parts, now_ns)


def _host_row(now_ns: int) -> HostRow:
    clock = time.get_clock_info("monotonic")
    return HostRow(
        now_ns,
        platform.node(),
        f"{platform.system()} {platform.release()} {platform.machine()}",
        platform.python_version(),
        os.cpu_count() or 1,
        clock.implementation,
        max(1, round(clock.resolution * 1e9)),
        datetime.now(UTC).isoformat(timespec="milliseconds"),
    )


def config_row(settings: dict[str, Any], parts: Parts, now_ns: int) -> ConfigRow:
    """Settings as asked for, and the gate in force."""
    shown = {section: _without_keys(values) for section, values in settings.items()}
    verbs = parts.gate.vocabulary
    never = [name for name in verbs.names if name not in verbs.assisted]
    return ConfigRow(now_ns, {**shown, "gate_in_force": {**parts.gate.settings(), "never_assisted": never}})


def _without_keys(values: Any) -> Any:
    if not isinstance(values, dict):
        return values
    hidden = {name for name, value in values.items() if value is not None and _is_secret(name)}
    return {name: GIVEN if name in hidden else _without_keys(value) for name, value in values.items()}


def _is_secret(name: str) -> bool:
    return any(word in name.lower() for word in _SECRET)


def bundle_row(parts: Parts, now_ns: int, intent: str = "predictor") -> BundleRow:
    """The bundle in use; `intent` says where beliefs come from if not from it."""
    return BundleRow(
        now_ns,
        parts.bundle.bundle_id,
        _sha256(parts.bundle_path),
        parts.bundle.window_steps,
        parts.bundle.vocabulary.names,
        parts.gate.tau_on,
        parts.gate.tau_off,
        intent,
        None if parts.bundle.provenance is None else parts.bundle.provenance.as_json(),
        parts.bundle.doubt,
    )


@cache
def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def revision() -> str | None:
    """The commit that the sources are of; None where they are no checkout, or git is not there to ask."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return None
    try:
        said = subprocess.run(
            ["git", "-C", str(root), "rev-parse", "HEAD"], capture_output=True, text=True, timeout=_GIT_S, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return said.stdout.strip() or None
