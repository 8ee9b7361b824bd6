"""A bus as bridge and device would fill it, frame by frame."""

from __future__ import annotations

from hilbridge.limits import MS
from hilbridge.monitor.state import Watch
from hilbridge.wire.codec import Codec
from hilbridge.wire.link import WireLink

CODEC = Codec()


class Bus:
    """Both ends on one clock, and a watch that hears them."""

    def __init__(self) -> None:
        self.watch = Watch(CODEC, 0)
        self.now_ns = 0
        self.bridge = WireLink(CODEC, "BRIDGE")
        self.device = WireLink(CODEC, "CONTROLLER")
        self.state, self.reason, self.verb = "Ready", "Hold", "None"
        self.sensors, self.age_ms, self.confidence, self.bundle = 0b111, 20, 50, 0x2C67
        self.bridge_runs = self.device_runs = True

    def send(self, link, message, **signals):
        self.watch.take(link.encode(message, signals), self.now_ns)

    def run(self, ms: int) -> dict:
        """Pass time in steps of 20 ms; the view at its end."""
        for _ in range(ms // 20):
            self.now_ns += 20 * MS
            step = self.now_ns // (20 * MS)
            if self.device_runs:
                self.send(
                    self.device, "CTRL_STATUS", State=self.state, Reason=self.reason, AppliedVerb=self.verb, Armed=1
                )
                self.send(self.device, "CTRL_MEAS", Joint="Elbow", Angle=90.0, AssistTorque=0.5)
            if self.bridge_runs and step % 2 == 0:
                gate, verb = ("Act", self.verb) if self.verb != "None" else ("Hold", "None")
                self.send(
                    self.bridge, "ACT_CMD", Gate=gate, Verb=verb, Confidence=self.confidence, SensingAge=self.age_ms
                )
            if self.bridge_runs and step % 4 == 0:
                self.send(
                    self.bridge,
                    "BRIDGE_HB",
                    SensorValid=self.sensors,
                    BridgeState="Running",
                    BundleId=self.bundle,
                    ProtocolVersion=1,
                )
            self.watch.advance(self.now_ns)
        return self.watch.view(self.now_ns)
