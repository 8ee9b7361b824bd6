"""From a configuration to a bridge that can run: every part opened and checked before anything moves."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.options import checked_options
from hilbridge.bus.port.spec import parse_spec
from hilbridge.bus.port.state import PortState
from hilbridge.config import BusConfig, Config, GateSection
from hilbridge.core.bridge import Bridge, BridgeConfig
from hilbridge.core.gate import GateConfig
from hilbridge.errors import InputError
from hilbridge.intent.bundle import Bundle, Thresholds, demo_bundle_path, load_bundle
from hilbridge.intent.predictor import Predictor
from hilbridge.intent.provenance import LEAST_PEOPLE, Origin, refusal
from hilbridge.intent.tremor import TremorGuard
from hilbridge.limits import MS
from hilbridge.rows import EventRow, TickRow
from hilbridge.runtime.account.judge import Judge
from hilbridge.runtime.deciding import Predicts
from hilbridge.runtime.live import LiveBridge, Recorder
from hilbridge.runtime.node import BridgeNode
from hilbridge.runtime.senses import Senses
from hilbridge.wire.codec import Codec
from hilbridge.wire.keys import load_key
from hilbridge.wire.link import WireLink
from hilbridge.wire.secoc import Authenticator

if TYPE_CHECKING:
    from collections.abc import AsyncIterator


@dataclass(frozen=True, slots=True)
class Parts:
    """What needs no bus: read and checked first, so that a wrong file is found before a device is touched."""

    bundle: Bundle
    gate: GateConfig
    codec: Codec
    bundle_path: Path


def read_parts(config: Config) -> Parts:
    """Read bundle and DBC, settle the gate's thresholds. Raises InputError."""
    path = Path(config.model.bundle) if config.model.bundle else demo_bundle_path()
    bundle = load_bundle(path)
    codec = Codec(Path(config.bus.dbc) if config.bus.dbc else None)
    gate = gate_config(config.gate, bundle)
    return Parts(bundle, replace(gate, vocabulary=bundle.vocabulary.on_the_bus(codec.verbs)), codec, path)


def gate_config(section: GateSection, bundle: Bundle) -> GateConfig:
    """Thresholds that were asked for over those of the bundle. Raises InputError when they do not make a band."""
    own = bundle.thresholds if section.precision is None else _thresholds_for(section.precision, bundle)
    tau_on = section.tau_on if section.tau_on is not None else own.tau_on
    tau_off = section.tau_off if section.tau_off is not None else own.tau_off
    try:
        return GateConfig(
            tau_on=tau_on,
            tau_off=tau_off,
            alpha=section.alpha,
            top_k=section.top_k,
            refractory_ns=section.refractory_ms * MS,
            max_age_ns=section.max_age_ms * MS,
            maps=bundle.maps,
            vocabulary=bundle.vocabulary,
            usual=bundle.usual,
        )
    except ValueError as error:
        raise InputError(f"gate: {error}; set both tau_on and tau_off (or neither: the bundle has them)") from None


def _thresholds_for(precision: float, bundle: Bundle) -> Thresholds:
    """The lowest tau_on from which on the bundle's replay reaches `precision`, with the bundle's own hysteresis."""
    tau_on = bundle.tau_for(precision)
    if tau_on is None:
        best = max((point.precision for point in bundle.curve), default=0.0)
        raise InputError(
            f"gate.precision = {precision:g}: bundle {bundle.bundle_id:#06x} reaches {best:.3f} at most on people it has not "
            "seen; ask for less, or train on more people"
        )
    band = bundle.thresholds.tau_on - bundle.thresholds.tau_off
    return Thresholds(tau_on, max(0.02, round(tau_on - band, 6)))


def open_port(config: BusConfig, on_change: Callable[[PortState], None] | None) -> BusPort:
    """The port the configuration names, not yet connected. `--arm` implies that the bridge may send."""
    listen_only = False if config.arm else config.listen_only
    options = checked_options(parse_spec(config.spec), config.options)
    return BusPort.open(config.spec, listen_only=listen_only, on_change=on_change, **options)


def build_node(
    parts: Parts,
    port: BusPort,
    config: BusConfig,
    on_event: Callable[[int, str], None],
    predict: Predicts | None = None,
    *,
    on_a_bench: bool = False,
) -> BridgeNode:
    """The node for a connected port. Raises InputError for a key that may not be used on it.

    `on_a_bench`: somebody has said that nobody wears the device; then a bundle of simulated people alone arms (decision 404).
    """
    if port.is_physical and config.arm and on_a_bench:
        refuse_people(config.spec, parts.bundle)
    elif port.is_physical and config.arm:
        why = refusal(parts.bundle.provenance, parts.bundle.doubt, parts.gate.tau_on, uncertified=config.uncertified)
        other = _another_gate(parts)
        if why is not None:
            raise InputError(
                f"bundle {parts.bundle.bundle_id:#06x}: {why}, refused with --arm on a physical bus; give with --bundle one "
                f"trained on {LEAST_PEOPLE} recorded people or more (`hilbridge train --data`) and certified on others "
                "(`hilbridge certify --data`)"
            )
        if other is not None:
            raise InputError(
                f"bundle {parts.bundle.bundle_id:#06x}: {other}, refused with --arm on a physical bus; leave that setting out"
            )
        if config.uncertified:
            on_event(time.monotonic_ns(), "UNCERTIFIED: this bench runs a threshold that nobody certified")
    lacking = parts.bundle.vocabulary.lacking(parts.codec.verbs)
    if lacking:
        on_event(
            time.monotonic_ns(),
            f"verbs without a name in the DBC's value table of ACT_CMD.Verb: {', '.join(lacking)}; predicted, never assisted; "
            "add them to the table (and to the device), or rename them in verbs.csv and train again",
        )
    key = load_key(Path(config.key_file) if config.key_file else None, physical=port.is_physical and config.arm)
    asked = BridgeConfig(arm=config.arm or not port.is_physical, listen_only=port.listen_only)
    return assemble_node(parts, key, lambda: secrets.randbits(32), asked, on_event, predict)


def refuse_people(spec: str, bundle: Bundle) -> None:
    """Raises InputError unless the bundle says that it is of simulated people: a bench must never be a person's bus."""
    origin = None if bundle.provenance is None else bundle.provenance.origin
    if origin is not Origin.SIMULATED or bundle.doubt is not None:
        of = bundle.doubt or origin or "unknown origin"
        raise InputError(f"bus {spec}: the bundle is of {of}, and only one of simulated people is for a bench")


def _another_gate(parts: Parts) -> str | None:
    """What makes the gate another one than was calibrated and certified; None where nothing does."""
    own, gate = gate_config(GateSection(), parts.bundle), parts.gate
    for name in ("alpha", "top_k", "refractory_ns"):
        if getattr(gate, name) != getattr(own, name):
            return f"gate.{name} = {getattr(gate, name)} is not the {getattr(own, name)} that it was certified with"
    if gate.tau_off < own.tau_off:
        return f"tau_off {gate.tau_off:g} is below {own.tau_off:g}, which it was certified with"
    return None


def assemble_node(
    parts: Parts,
    key: bytes,
    draw_nonce: Callable[[], int],
    config: BridgeConfig,
    on_event: Callable[[int, str], None],
    predict: Predicts | None = None,
) -> BridgeNode:
    """A node that has seen and sent nothing yet, for live runs and virtual time. predict: default, the bundle's own."""
    wire = WireLink(parts.codec)
    asked = replace(config, vocabulary=parts.gate.vocabulary)
    bridge = Bridge(wire, Authenticator(key), draw_nonce, asked, lambda: wire.counters)
    return BridgeNode(
        predict or Predictor(parts.bundle), parts.gate, bridge, wire, parts.bundle.bundle_id, TremorGuard(), on_event
    )


@asynccontextmanager
async def live_bridge(
    config: Config,
    parts: Parts,
    senses: Senses,
    record: Recorder,
    *,
    judge: Judge | None = None,
    on_tick: Callable[[TickRow], None] = lambda row: None,
    predict: Predicts | None = None,
) -> AsyncIterator[LiveBridge]:
    """A bridge on its bus, ready to `run()`. Raises InputError when the bus or the key cannot be used."""
    live: LiveBridge | None = None

    def on_change(state: PortState) -> None:
        if live is not None:
            live.on_port_change(state)

    def on_event(now_ns: int, text: str) -> None:
        record(EventRow(now_ns, text))

    async with open_port(config.bus, on_change) as port:
        node = build_node(parts, port, config.bus, on_event, predict)
        live = LiveBridge(node, port, senses, record, judge=judge, on_tick=on_tick)
        yield live
