"""A whole bridge in a process of its own whose predictor is always sure of one verb, so that the device assists.

Everything else is real: simulated senses as sources, features, gate, protocol, codec, port. Words on its pipe set faults
of its sensors (`camera frozen`, `gaze gone`, ...; `well` ends them). Says `ready` there when it ticks.
"""

from __future__ import annotations

import asyncio
import threading
from multiprocessing.connection import Connection

from hilbridge.config import BusConfig, Config, GateSection
from hilbridge.priority import use_realtime_scheduling
from hilbridge.records import FeatureVector, IntentEstimate
from hilbridge.runtime.assemble import live_bridge, read_parts
from hilbridge.runtime.live import LiveBridge
from hilbridge.runtime.simulated_senses import SensorFault, SimulatedSenses
from hilbridge.verbs import VERBS
from hilbridge.wearer.person import Wearer

GATE = GateSection(alpha=1.0, refractory_ms=40)
PARTS = read_parts(Config(gate=GATE))  # DBC and bundle, read once by the server that forks bridges
VERB = VERBS.index("Pour")  # damping and gravity support in any movement: torque that can be seen


class Sure:
    """Believes in one verb with 0.97, whatever it sees."""

    def step(self, vector: FeatureVector, produced_ns: int) -> IntentEstimate | None:
        rest = 0.03 / (len(VERBS) - 1)
        probabilities = tuple(0.97 if index == VERB else rest for index in range(len(VERBS)))
        return IntentEstimate(vector.oldest_input_ns, produced_ns, probabilities, VERB, 0.97, 1, vector.valid)

    def reset(self) -> None: ...


def obey(senses: SimulatedSenses, live: LiveBridge, pipe: Connection) -> None:
    """Set sensor faults as told, and tell what is asked, until the rig is gone."""
    while True:
        try:
            name, _, fault = pipe.recv().partition(" ")
        except EOFError:
            return
        if name == "tell":
            session = live.node.bridge.session
            told = {"decision": str(live.node.bridge.command), "device": str(live.node.bridge.device)}
            told |= {"phase": str(session.phase), "refused": session.refused, "why": session.why}
            pipe.send({**told, "sensors": str(senses.seen()), **live.counters()})
        elif name == "well":
            senses.camera.fault = senses.gaze.fault = SensorFault.NONE
        else:
            {"camera": senses.camera, "gaze": senses.gaze}[name].fault = SensorFault(fault)


async def bridge(bus: str, pipe: Connection) -> None:
    config = Config(bus=BusConfig(spec=bus), gate=GATE)
    senses = SimulatedSenses(lambda: Wearer(3, width_px=96, height_px=72), config.sensors)
    async with live_bridge(config, PARTS, senses, lambda *row: None, predict=Sure()) as live:
        threading.Thread(target=obey, args=(senses, live, pipe), daemon=True).start()
        pipe.send("ready")
        await live.run()


def main(bus: str, pipe: Connection) -> None:
    """The process's body."""
    use_realtime_scheduling()
    asyncio.run(bridge(bus, pipe))
