"""What is well on this machine, what is not, and the command that mends it."""

from __future__ import annotations

import asyncio
import importlib.metadata
import os
import platform
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hilbridge.doctor_sensors import Finding, Verdict, check_body, check_camera, check_gaze, tried
from hilbridge.errors import InputError
from hilbridge.lease import run_leased
from hilbridge.priority import Level
from hilbridge.records import Frame

if TYPE_CHECKING:
    from hilbridge.config import Config
    from hilbridge.sensors.live.lsl import LslChannels

__all__ = ["Finding", "Verdict", "examine", "worst"]

_RUN_PACKAGES = ("python-can", "cantools", "numpy", "opencv-python-headless", "cryptography", "mcap")
_EXTRAS = {"hands": "mediapipe", "train": "torch"}


def check_python() -> Finding:
    text = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    return Finding("python", Verdict.WELL, text)


def check_packages() -> list[Finding]:
    findings = []
    missing = [name for name in _RUN_PACKAGES if _version(name) is None]
    if missing:
        findings.append(Finding("packages", Verdict.ILL, f"missing: {', '.join(missing)}", "pip install hilbridge"))
    else:
        shown = ", ".join(f"{name} {_version(name)}" for name in _RUN_PACKAGES[:4])
        findings.append(Finding("packages", Verdict.WELL, shown))
    for extra, package in _EXTRAS.items():
        version = _version(package)
        if version is None:
            cure = f"pip install 'hilbridge[{extra}]'"
            findings.append(Finding(f"extra {extra}", Verdict.NOTE, f"{package} is not installed", cure))
        else:
            findings.append(Finding(f"extra {extra}", Verdict.WELL, f"{package} {version}"))
    return findings


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def check_hand_model(path: Path | None = None) -> Finding:
    from hilbridge.sensors.models import hand_model_path, hand_model_problem

    path = path or hand_model_path()
    problem = hand_model_problem(path)
    if problem is None:
        return Finding("hand model", Verdict.WELL, str(path))
    return Finding("hand model", Verdict.NOTE, f"{path}: {problem}", "hilbridge fetch-models --force")


def check_controller() -> Finding:
    """Which controller scenarios run: the C where it was built, else the slower reference. Asked of the device itself."""
    command = [sys.executable, "-m", "firmware_sim.controllers"]
    told = run_leased(command).stdout.strip()
    if told == "built":
        return Finding("controller", Verdict.WELL, "C, built from the sources that are here")
    what, _, cure = told.partition(": ")
    return Finding("controller", Verdict.NOTE, f"Python, the same in more time; the C is {what or 'not there'}", cure)


def check_profiles() -> Finding:
    """Which assist profiles the simulated device has, by their hash; a device of a site tells its own. Asked of it, too."""
    done = run_leased([sys.executable, "-m", "firmware_sim.profile_file"])
    if done.returncode == 0:
        return Finding("profiles", Verdict.WELL, f"of the simulated device: {done.stdout.strip()}")
    return Finding("profiles", Verdict.ILL, " ".join(done.stderr.split())[-200:], "pip install hilbridge again")


def check_bundle(path: Path | None) -> Finding:
    from hilbridge.intent.bundle import demo_bundle_path, load_bundle

    def look() -> str:
        bundle = load_bundle(path or demo_bundle_path())
        return f"{path or 'the one that ships'}: id {bundle.bundle_id:#06x}, tau_on {bundle.thresholds.tau_on:.2f}"

    return tried("bundle", look)


def check_clock(samples: int = 50, pause: Callable[[float], None] = time.sleep) -> Finding:
    """How late this machine wakes a sleeper: a 25 Hz tick lives on that."""
    late_ms = []
    for _ in range(samples):
        begin_ns = time.monotonic_ns()
        pause(0.002)
        late_ms.append((time.monotonic_ns() - begin_ns) / 1e6 - 2.0)
    worst = max(late_ms)
    resolution_us = time.get_clock_info("monotonic").resolution * 1e6
    text = f"wakes {statistics.median(late_ms):.2f} ms late (worst {worst:.2f}), resolution {resolution_us:.3g} us"
    if worst > 20.0:
        return Finding("clock", Verdict.NOTE, text, "close what else is busy; a late tick holds and is counted")
    return Finding("clock", Verdict.WELL, text)


def check_realtime() -> Finding:
    """Whether the bridge may schedule its tick before everything else."""
    elsewhere = Finding("real time", Verdict.NOTE, "not offered here", "a busy machine makes ticks late; prefer Linux")
    if sys.platform != "linux":
        return elsewhere
    try:
        import resource
    except ImportError:
        return elsewhere
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    if os.geteuid() == 0 or limit >= Level.TICK:
        return Finding("real time", Verdict.WELL, "round-robin scheduling is allowed")
    cure = "add `@realtime - rtprio 20` to /etc/security/limits.d and yourself to that group"
    return Finding("real time", Verdict.NOTE, f"rtprio limit is {limit}", cure)


async def _hear(spec: str, options: Mapping[str, Any], seconds: float) -> list[Finding]:
    """Listen on a bus without sending, and say who is there."""
    from hilbridge.bus.diagnosis import Severity, diagnose, known_messages, observation_of
    from hilbridge.bus.port.asyncio_port import BusPort
    from hilbridge.bus.port.options import checked_options
    from hilbridge.bus.port.spec import parse_spec
    from hilbridge.core.bridge import Bridge, BridgeConfig
    from hilbridge.wire.codec import Codec, Decoded
    from hilbridge.wire.keys import DEMO_KEY
    from hilbridge.wire.link import WireLink
    from hilbridge.wire.secoc import Authenticator

    wire = WireLink(Codec())
    listener = Bridge(wire, Authenticator(DEMO_KEY), lambda: 0, BridgeConfig(arm=False, listen_only=True), dict)
    names: Counter[str] = Counter()
    frames: list[Frame] = []
    sound = checked_options(parse_spec(spec), options)
    async with BusPort.open(spec, listen_only=True, **sound) as port:
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0:
            try:
                frame = await asyncio.wait_for(port.receive(), left_s)
            except TimeoutError:
                break
            frames.append(frame)
            outcome = wire.decode(frame)
            names[outcome.name or f"{frame.can_id:#05x}"] += 1
            if isinstance(outcome, Decoded):
                listener.on_message(outcome.name, outcome.signals, outcome.counter, frame.received_ns)
        kind = "physical" if port.is_physical else "virtual"
        state = port.state
        seen = observation_of(port, frames, seconds)
    heard = ", ".join(f"{name} {count}" for name, count in sorted(names.items())) or "nothing"
    findings = [
        Finding(
            "bus",
            Verdict.WELL if state.link_up else Verdict.ILL,
            f"{port.spec} ({kind}), controller {state.controller}, heard in {seconds:g} s: {heard}",
            "" if state.link_up else f"ip link set {port.spec} up",
        )
    ]
    for ailment in diagnose(seen, known_messages(wire.codec.path)):
        if ailment.severity is not Severity.WELL:
            findings.append(Finding(ailment.subject, Verdict(ailment.severity.value), ailment.text, ailment.cure))
    if listener.device is None:
        findings.append(Finding("device", Verdict.NOTE, "no CTRL_STATUS heard", f"firmware-sim --bus {port.spec}"))
    else:
        findings.append(Finding("device", Verdict.WELL, f"{listener.device.state}, {listener.device.reason}"))
    for who, counters in (("device", listener.device_diag), ("this side", wire.counters)):
        rejected = {name: n for name, n in counters.items() if name.startswith("Rej") and n}
        if rejected:
            text = ", ".join(f"{name} {count}" for name, count in rejected.items())
            findings.append(
                Finding(f"rejected by {who}", Verdict.NOTE, text, "`hilbridge docs safety` says what each means")
            )
    return findings


def _channels(settings: Config) -> LslChannels:
    from hilbridge.sensors.live.lsl import LslChannels

    return LslChannels(**settings.sensors.lsl.model_dump())


def check_bus(spec: str, options: Mapping[str, Any] | None = None, seconds: float = 2.5) -> list[Finding]:
    """Bus state and who speaks on it, listening only. The device's DIAG counters take a second each to come round."""
    try:
        return asyncio.run(_hear(spec, options or {}, seconds))
    except InputError as error:
        text, _, cure = str(error).partition("; ")
        return [Finding("bus", Verdict.ILL, text, cure)]


def examine(settings: Config, *, look_at_bus: bool) -> list[Finding]:
    """Everything, in the order in which a newcomer needs it."""
    bundle = None if settings.model.bundle is None else Path(settings.model.bundle)
    findings = [check_python(), *check_packages(), check_bundle(bundle), check_hand_model(), check_controller()]
    findings.append(check_profiles())
    findings += [check_camera(settings.sensors.camera), check_gaze(settings.sensors.gaze, _channels(settings))]
    findings += [
        check_body(what, spec)
        for what, spec in (("inertial", settings.sensors.inertial), ("skeleton", settings.sensors.skeleton))
        if spec is not None
    ]
    if look_at_bus:
        findings += check_bus(settings.bus.spec, settings.bus.options)
    else:
        findings.append(Finding("bus", Verdict.NOTE, "none given", "hilbridge doctor --bus auto"))
    return [*findings, check_clock(), check_realtime()]


def worst(findings: Iterable[Finding]) -> Verdict:
    """The gravest verdict among the findings."""
    order = list(Verdict)
    return max((finding.verdict for finding in findings), key=order.index, default=Verdict.WELL)
