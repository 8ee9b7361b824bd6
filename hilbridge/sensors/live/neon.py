"""Pupil Labs Neon and Pupil Invisible live, through the vendor's client: status, time echo, gaze and eye events over RTSP."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from hilbridge.errors import InputError, needs_extra
from hilbridge.limits import MS
from hilbridge.records import StampSource
from hilbridge.sensors.clock import DeviceClock, Probe
from hilbridge.sensors.live.base import RETRY_FIRST_S, RETRY_MOST_S, LiveGaze, RawGaze

PORT = 8080
_ANSWER_S = 3.0
_DISCOVERY_S = 5.0
_SILENT_S = 1.0
_PROBE_S = 0.25
_FIRST_PROBES = 20
_WATCH_S = 0.05
_LID_OPEN_MM = 2.0  # both lids less open: a blink
_TICK_NS = MS  # the echo counts whole milliseconds


class Glasses(NamedTuple):
    """A connected pair: its name, the size of its scene picture, and where its streams are."""

    name: str
    width_px: int
    height_px: int
    gaze_url: str
    events_url: str | None
    echo_port: int
    scene_url: str | None = None


class _Lost(Exception):
    """The connection is of no use any more, and why."""


class NeonGaze(LiveGaze):
    """`host` may be HOST or HOST:PORT; empty: the first device that the network announces.

    Raises InputError when none answers at the start; later it is looked for again and again.
    """

    def __init__(self, host: str = "", *, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        super().__init__(f"gaze neon:{host}", DeviceClock(), stamp=StampSource.RTCP, clock_ns=clock_ns)
        with needs_extra("pupil"):
            import pupil_labs.realtime_api as api
            from pupil_labs.realtime_api.time_echo import TimeOffsetEstimator
        self._api: Any = api
        self._request_echo: Any = TimeOffsetEstimator.request_time_echo
        for noisy in ("aiortsp", "pupil_labs"):  # they log what this module reports in a line of its own
            logging.getLogger(noisy).setLevel(logging.CRITICAL + 1)
        name, _, port = host.partition(":")
        if port and not port.isdigit():
            raise InputError(f"gaze neon:{host}: {port!r} is no port; write neon:HOST or neon:HOST:PORT")
        self._host, self._port = name, int(port) if port else PORT
        try:
            self.glasses: Glasses = asyncio.run(self._find())
        except _Lost as error:
            raise InputError(
                f"gaze neon:{host}: {error}; is the Companion app open and in the same network? "
                "Give its address: --gaze neon:192.168.1.20"
            ) from None

    def _read_all(self) -> None:
        asyncio.run(self._follow())

    async def _follow(self) -> None:
        """Connect, stream, and again, until the source is to stop."""
        wait_s = RETRY_FIRST_S
        while not self._stopping.is_set():
            began_ns = self._clock_ns()
            try:
                await self._until_stopped(self._once())
            except* Exception as group:  # the client raises what its libraries raise
                self.lose(_why(group))
            held_s = (self._clock_ns() - began_ns) / 1e9
            wait_s = RETRY_FIRST_S if held_s > 5.0 else min(RETRY_MOST_S, 2 * wait_s)
            await self._until_stopped(asyncio.sleep(wait_s))

    async def _until_stopped(self, work: Any) -> None:
        """Await `work`, but no longer than until the source is to stop."""
        task = asyncio.ensure_future(work)
        while not task.done() and not self._stopping.is_set():
            await asyncio.wait({task}, timeout=_WATCH_S)
        if not task.done():
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError, Exception, BaseExceptionGroup):
                await task
            return
        task.result()

    async def _find(self) -> Glasses:
        """Ask a device what it is. Raises _Lost."""
        host, port = (self._host, self._port) if self._host else await self._discover()
        device = self._api.Device(host, port)
        try:
            status = await asyncio.wait_for(device.get_status(), _ANSWER_S)
        except TimeoutError:
            raise _Lost(f"{host}:{port} does not answer") from None
        except Exception as error:
            raise _Lost(f"{host}:{port} does not answer ({type(error).__name__})") from None
        finally:
            await device.close()
        return _glasses(status, host)

    async def _discover(self) -> tuple[str, int]:
        async for found in self._api.discover_devices(timeout_seconds=_DISCOVERY_S):
            return found.addresses[0], found.port
        raise _Lost(f"no device announced itself within {_DISCOVERY_S:g} s")

    async def _once(self) -> None:
        """One connection, until something of it fails."""
        self.glasses = glasses = await self._find()
        host = self._host or glasses.gaze_url.split("//")[1].partition(":")[0]
        heard = [self._clock_ns()]
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._echo(host, glasses.echo_port))
            tasks.create_task(self._gaze(glasses, heard))
            tasks.create_task(self._watch(heard))
            if glasses.events_url is not None:
                tasks.create_task(self._events(glasses.events_url))

    async def _gaze(self, glasses: Glasses, heard: list[int]) -> None:
        async with self._api.RTSPGazeStreamer(glasses.gaze_url, timeout=_ANSWER_S) as streamer:
            async for datum in streamer.receive():
                heard[0] = self._clock_ns()
                self.take_raw(_raw(datum, glasses))
        raise _Lost("the device has ended the stream")

    async def _watch(self, heard: list[int]) -> None:
        while self._clock_ns() - heard[0] < _SILENT_S * 1e9:
            await asyncio.sleep(_WATCH_S)
        raise _Lost(f"no gaze for {_SILENT_S:g} s")

    async def _echo(self, host: str, port: int) -> None:
        """Probe the device's clock, quickly at first. One that does not answer is asked again; doubt grows meanwhile."""
        assert self.clock is not None
        asked = 0
        while True:
            with contextlib.suppress(OSError, TimeoutError, ValueError):
                reader, writer = await asyncio.wait_for(asyncio.open_connection(host, port), _ANSWER_S)
                try:
                    while True:
                        probe = await asyncio.wait_for(self._probe(reader, writer), _SILENT_S)
                        asked += 1
                        steps = self.clock.steps
                        self.take_probe(probe)
                        if self.clock.steps != steps:  # the stream's stamps follow it only after its next report
                            raise _Lost(self.detail)
                        quick = asked < _FIRST_PROBES or self.clock.fit is None
                        await asyncio.sleep(0.01 if quick else _PROBE_S)
                finally:
                    writer.close()
            await asyncio.sleep(_PROBE_S)

    async def _probe(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> Probe:
        """One time echo. The device gives back the number that it was sent, so it may be in our own unit."""
        taken: list[int] = []

        def now_ns() -> int:
            taken.append(self._clock_ns())
            return taken[-1]

        echo = await self._request_echo(now_ns, reader, writer)
        sent_ns, received_ns = taken
        device_ms = round((sent_ns + received_ns) / 2) - echo.time_offset_ms
        return Probe(sent_ns, device_ms * MS + _TICK_NS // 2, received_ns)

    async def _events(self, url: str) -> None:
        """Blinks, as the app finds them: it says so when they are over, so they are for the recording only."""
        with contextlib.suppress(OSError, RuntimeError, ValueError):
            async with self._api.RTSPEyeEventStreamer(url, timeout=_ANSWER_S) as streamer:
                async for event in streamer.receive():
                    if isinstance(event, self._api.BlinkEventData):
                        self.on_event(f"{self.name}: blink of {(event.end_time_ns - event.start_time_ns) / MS:.0f} ms")


def _glasses(status: Any, host: str) -> Glasses:
    """What a status says. Raises _Lost where it does not affirm all that is needed."""
    hardware, sensor = status.hardware, status.direct_gaze_sensor()
    version = str(hardware.version)
    if version.startswith("2") or hardware.module_serial not in ("unknown", "default", ""):
        name, width_px, height_px = "Neon", 1600, 1200
    elif version.startswith("1") or hardware.glasses_serial not in ("unknown", "default", ""):
        name, width_px, height_px = "Pupil Invisible", 1088, 1080
    else:
        raise _Lost(f"{host}: the phone says no glasses of a known kind")
    if sensor is None or not sensor.connected:
        raise _Lost(f"{host}: no glasses are plugged into the phone")
    if not status.phone.time_echo_port:
        raise _Lost(f"{host}: the app has no time echo, so its clock cannot be known, update it")
    events = status.direct_eye_events_sensor()
    events_url = events.url if events is not None and events.connected else None
    scene = status.direct_world_sensor()
    scene_url = scene.url if scene is not None and scene.connected else None
    return Glasses(name, width_px, height_px, sensor.url, events_url, int(status.phone.time_echo_port), scene_url)


def _raw(datum: Any, glasses: Glasses) -> RawGaze:
    point = getattr(datum, "left", datum)  # one eye where the app sends both apart
    return RawGaze(
        point.x / glasses.width_px,
        point.y / glasses.height_px,
        not _is_blink(datum),
        bool(datum.worn),
        round(datum.timestamp_unix_seconds * 1e6) * 1000,
    )


def _is_blink(datum: Any) -> bool:
    left, right = getattr(datum, "eyelid_aperture_left", None), getattr(datum, "eyelid_aperture_right", None)
    return left is not None and right is not None and left < _LID_OPEN_MM and right < _LID_OPEN_MM


def _why(group: BaseExceptionGroup[BaseException]) -> str:
    """The first reason in one line."""
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return str(error) if isinstance(error, _Lost) else f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
