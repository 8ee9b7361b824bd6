"""The bridge live: asyncio tasks around one node, one port and the senses. The only scheduler there is."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import replace

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.state import PortState, SendResult
from hilbridge.limits import STOP_GAP_NS, STOP_REPEATS, TICK_GRACE_NS
from hilbridge.records import BodySample, CameraFrame, FeatureVector, Frame, GazeSample
from hilbridge.rows import (
    CountersRow,
    EventRow,
    Look,
    Row,
    SensorsRow,
    TickRow,
    belief_row,
    body_row,
    features_row,
    gaze_row,
    hands_row,
    received_row,
    sent_row,
    with_truth,
)
from hilbridge.runtime.account.device_view import DeviceView
from hilbridge.runtime.account.judge import Judge
from hilbridge.runtime.account.losses import Losses
from hilbridge.runtime.account.notices import DEAF_NS, Facts, Notices
from hilbridge.runtime.account.stages import Stages
from hilbridge.runtime.body import Kind
from hilbridge.runtime.node import BridgeNode
from hilbridge.runtime.phase import locks_to, next_tick
from hilbridge.runtime.senses import Senses
from hilbridge.sensors.source import SourceState

Recorder = Callable[[Row], None]

_HOUSEKEEPING_S = 1.0


class LiveBridge:
    """Runs until told to stop, until a recording that it plays ends, or until something fails.

    record: takes rows. judge: None where the wearer's intention is not known. on_tick: shown each row.
    `on_notice` may be set: it is told in a line what a person at the terminal has to know (`notices`). So may `on_picture`,
    which keeps pictures and must not take its time.
    """

    def __init__(
        self,
        node: BridgeNode,
        port: BusPort,
        senses: Senses,
        record: Recorder,
        *,
        judge: Judge | None = None,
        on_tick: Callable[[TickRow], None] = lambda row: None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.node, self.port, self.senses = node, port, senses
        self.ticks_missed = 0
        self.tick_late_max_ms = 0.0
        self._record, self._judge, self._on_tick, self._clock_ns = record, judge, on_tick, clock_ns
        self.on_notice: Callable[[str], None] = lambda text: None
        self.on_picture: Callable[[CameraFrame, Look], None] = lambda frame, look: None  # in the vision worker's thread
        self._notices = Notices()
        self._clearing: bool | None = None  # whether a challenge to clear has been answered
        self._stopping = asyncio.Event()
        self._new_features = asyncio.Event()
        self.stages: Stages | None = None
        self._device = DeviceView()
        self._clock_known = False
        self._port_drops = 0
        self.losses = Losses()

    def stop(self) -> None:
        """End after the tick under way: one HOLD, then silence."""
        self._stopping.set()

    def request_clear_latch(self) -> None:
        """Authenticate the clearing of a latch or stop; a hand at the device has to confirm it."""
        self._clearing = False
        self.node.bridge.request_clear_latch()

    def request_stop_frame(self) -> None:
        """Put STOP on the bus: three frames, 10 ms apart. From the loop's own thread."""
        now_ns = self._clock_ns()
        self._record(EventRow(now_ns, "STOP was asked for"))
        self._send_all(self.node.bridge.request_stop(now_ns))
        loop = asyncio.get_running_loop()
        for repeat in range(1, STOP_REPEATS):
            # A moment late rather than early: `poll` gives only what is due.
            loop.call_later(repeat * (STOP_GAP_NS / 1e9 + 0.001), self._repeat_stop)

    def _repeat_stop(self) -> None:
        self._send_all(self.node.bridge.poll(self._clock_ns()))

    def profile(self) -> Stages:
        """Tell from now on how long each stage takes."""
        self.stages = self.senses.vision.stages = Stages()
        return self.stages

    async def run(self, seconds: float | None = None) -> None:
        """Start the senses, tick at 25 Hz, stop everything again, whatever happens."""
        loop = asyncio.get_running_loop()
        self.senses.vision.on_vector = lambda: _call_on(loop, self._new_features.set)
        self.senses.vision.on_look = self._note_look
        self.senses.vision.on_event = lambda text: _call_on(loop, lambda: self._note_event(text))
        if self.senses.gaze is not None:
            self.senses.gaze.on_value = self._note_gaze
        self.senses.body.on_sample = self._note_body
        for device in self.senses.devices:
            device.on_event = lambda text: _call_on(loop, lambda: self._note_event(text))
        await asyncio.to_thread(self.senses.start)
        try:
            async with asyncio.TaskGroup() as tasks:
                helpers = [tasks.create_task(self._receive()), tasks.create_task(self._housekeep())]
                await self._tick_until(None if seconds is None else self._clock_ns() + round(seconds * 1e9))
                for helper in helpers:
                    helper.cancel()
        finally:
            await asyncio.to_thread(self.senses.stop)
            self._keep_house()

    def on_port_change(self, state: PortState) -> None:
        """To be told by the port."""
        if state.reason == "closed":
            return
        now_ns = self._clock_ns()
        text = f"bus: {'link up' if state.link_up else 'link down'}, controller {state.controller.name.lower()}"
        self._record(EventRow(now_ns, f"{text}{'; ' + state.reason if state.reason else ''}"))
        self.node.on_bus_state(state.controller, link_up=state.link_up)

    async def _tick_until(self, end_ns: int | None) -> None:
        due_ns = self._clock_ns()
        lock = locks_to(self.senses.camera_fps)
        first = True  # the features seen next are the first
        while not self._stopping.is_set():
            await self._sleep_until(due_ns)
            vector = await self._features(due_ns + TICK_GRACE_NS if lock else due_ns)
            now_ns = self._clock_ns()
            if self.senses.ended or (end_ns is not None and now_ns >= end_ns):
                return
            self.tick_late_max_ms = max(self.tick_late_max_ms, (now_ns - due_ns) / 1e6)
            if self.stages is not None:
                self.stages.add("tick late", max(0, now_ns - due_ns))
            self._tick(vector, now_ns)
            ready_ns = self.senses.vision.last_ready_ns
            known = lock and ready_ns is not None and ready_ns <= now_ns
            plan = next_tick(due_ns, self._clock_ns(), ready_ns if known else None, first=first)
            first = first and vector is None
            self.ticks_missed += plan.missed
            due_ns = plan.due_ns

    async def _features(self, until_ns: int) -> FeatureVector | None:
        """The newest features; a tick that is locked to the camera waits for them, but not beyond `until_ns`."""
        while True:
            self._new_features.clear()  # before looking, so that what comes in between is not slept through
            vector = self.senses.take()
            left_s = (until_ns - self._clock_ns()) / 1e9
            if vector is not None or left_s <= 0:
                return vector
            try:
                await asyncio.wait_for(self._new_features.wait(), left_s)
            except TimeoutError:
                return self.senses.take()

    def _tick(self, vector: FeatureVector | None, now_ns: int) -> None:
        felt = self.senses.body.felt
        tick = self.node.tick(vector, self.senses.seen(), now_ns, None if felt is None else felt.trembling)
        self._send_all(tick.frames)
        sent_ns = self._clock_ns()
        line = None if felt is None else felt.line
        truth = None if self._judge is None else self._judge(now_ns, tick.row.verb)
        row = replace(
            with_truth(tick.row, truth),
            work_ms=round((sent_ns - now_ns) / 1e6, 3),
            latency_ms=None if vector is None else round((sent_ns - vector.captured_ns) / 1e6, 3),
            felt_hz=None if line is None else round(line.hz, 2),
            felt_rms=None if line is None else round(line.rms, 3),
        )
        if tick.belief is not None:
            self._record(belief_row(tick.belief, now_ns, self.node.decider.gate_config.vocabulary))
        self._record(row)
        self._on_tick(row)
        if self.stages is not None:
            self.stages.add("tick", sent_ns - now_ns)
            if vector is not None:
                self.stages.add("features -> ACT_CMD", sent_ns - (self.senses.vision.last_ready_ns or sent_ns))
                self.stages.add("capture -> ACT_CMD", sent_ns - vector.captured_ns)

    def _note_look(self, frame: CameraFrame, look: Look) -> None:
        # All of one look have the time at which it was ready: a tick may have taken it meanwhile.
        self.on_picture(frame, look)
        if look.hands is not None:
            self._record(hands_row(look.hands, look.ready_ns))
        self._record(features_row(look))

    def _note_gaze(self, sample: GazeSample) -> None:
        self._record(gaze_row(sample, self._clock_ns()))

    def _note_body(self, kind: Kind, sample: BodySample) -> None:
        self._record(body_row(kind, sample, self._clock_ns()))

    def _note_event(self, text: str) -> None:
        self._record(EventRow(self._clock_ns(), text))
        self.on_notice(text)

    async def _sleep_until(self, due_ns: int) -> None:
        wait_s = (due_ns - self._clock_ns()) / 1e9
        if wait_s <= 0:
            await asyncio.sleep(0)
            return
        try:
            await asyncio.wait_for(self._stopping.wait(), wait_s)
        except TimeoutError:
            pass

    async def _receive(self) -> None:
        while True:
            frame = await self.port.receive()
            now_ns = self._clock_ns()
            decoded, answers = self.node.receive(frame, frame.received_ns or now_ns)
            self._send_all(answers)
            if answers and self._clearing is not None:
                self._clearing = True
            self._record(received_row(frame, None if decoded is None else decoded.name, now_ns))
            if decoded is not None and decoded.name == "CTRL_DIAG" and decoded.signals["Index"] == "TxDropped":
                self.losses.on_withdrawn(int(decoded.signals["TxDropped"]), self.node.wire.counters["LostFrames"])
            if decoded is not None and (row := self._device.take(decoded, now_ns)) is not None:
                self._record(row)

    def _send_all(self, frames: list[Frame]) -> None:
        for frame in frames:
            result = self.port.send(frame)
            if result in (SendResult.FULL, SendResult.DOWN):
                self.node.bridge.on_send_failed(bus_down=result is SendResult.DOWN)
            self._record(sent_row(frame, str(result), self._clock_ns()))
        # Frames that the port had queued and then dropped as stale are sends that failed, too.
        counters = self.port.counters
        drops = counters.dropped_stale + counters.dropped_superseded
        if drops != self._port_drops:
            self._port_drops = drops
            self.node.bridge.on_send_failed(bus_down=False)

    async def _housekeep(self) -> None:
        while True:
            self._notice()
            await asyncio.sleep(_HOUSEKEEPING_S)
            self._keep_house()

    def _notice(self) -> None:
        now_ns = self._clock_ns()
        for text in self._notices.look(self._facts(now_ns)):
            self._record(EventRow(now_ns, text))
            self.on_notice(text)

    def _facts(self, now_ns: int) -> Facts:
        bridge, camera = self.node.bridge, self.senses.camera
        device = bridge.device
        known = device is not None and now_ns - device.received_ns < DEAF_NS
        return Facts(
            now_ns,
            str(self.port.spec),
            self.port.is_physical,
            self.port.listen_only,
            heard=self.port.counters.received,
            device=(device.state, device.reason) if device is not None and known else None,
            refused=bridge.session.refused,
            foreign=self.node.foreign,
            pictures=camera.cell.counts().received,
            camera_alive=camera.state is SourceState.RUNNING,
            clearing=self._clearing,
        )

    def _keep_house(self) -> None:
        now_ns = self._clock_ns()
        self._record(SensorsRow(now_ns, self.senses.accounts()))
        clocks = self.senses.clocks(now_ns)
        for row in clocks:
            self._record(row)
        self._clock_known = self._clock_known or bool(clocks)
        if self._clock_known:  # where nobody has a clock of his own, nothing is said of it
            worst = max(clocks, key=lambda row: row.bound_ms, default=None)
            bound_ns, residual_ns = (None, 0) if worst is None else (worst.bound_ms * 1e6, worst.residual_ms * 1e6)
            self.node.on_clock(None if bound_ns is None else round(bound_ns), round(residual_ns))
        self._record(CountersRow(now_ns, self.counters()))

    def counters(self, withdrawn: int | None = None) -> dict[str, int]:
        """Every counter of the bridge by name. `withdrawn`: the device's own last word on that, where it is known."""
        port = {f"port.{name}": value for name, value in self.port.counters.as_dict().items()}
        wire = {f"wire.{name}": value for name, value in self.node.wire.counters.items()}
        bridge = {f"bridge.{name}": value for name, value in self.node.bridge.diag.items()}
        device = {f"device.{name}": value for name, value in self.node.bridge.device_diag.items()}
        gaps = self.node.wire.counters["LostFrames"]
        return {
            "frames_sent": self.port.counters.sent,
            "frames_received": self.port.counters.received,
            "frames_lost": self.losses.lost(gaps, withdrawn),
            "frames_lost_at_start": self.losses.before(gaps),
            "ticks_missed": self.ticks_missed,
            **bridge,
            **wire,
            **port,
            **device,
        }


def _call_on(loop: asyncio.AbstractEventLoop, callback: Callable[[], object]) -> None:
    try:
        loop.call_soon_threadsafe(callback)
    except RuntimeError:  # the loop has closed while the worker finished its last picture
        return
