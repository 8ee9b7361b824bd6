"""`hilbridge monitor`: a bus or a recording on a page, until Ctrl-C."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.intent.bundle import Bundle, load_bundle
from hilbridge.monitor.access import Access
from hilbridge.monitor.card import card_lines
from hilbridge.monitor.playback import Playback
from hilbridge.monitor.server import Server
from hilbridge.monitor.state import Thresholds, Watch
from hilbridge.monitor.station import Station
from hilbridge.observe.keeping.sharing import SharedPicture, newest_picture, shared_path
from hilbridge.priority import Level, use_realtime_scheduling
from hilbridge.wire.codec import Codec

Told = Callable[[str], None]


class LiveBus:
    """What the server shows of a bus."""

    def __init__(self, bus: str, station: Station, bundle: Bundle, *, can_stop: bool) -> None:
        self._bus = bus
        self._station = station
        self._bundle = bundle
        self._can_stop = can_stop
        self._shared = shared_path(bus)

    def about(self) -> dict[str, Any]:
        """What does not change while the page is open."""
        bundle = self._bundle
        provenance = None if bundle.provenance is None else bundle.provenance.as_json()
        tau_on, tau_off = bundle.thresholds.tau_on, bundle.thresholds.tau_off
        return {
            "live": True,
            "title": self._bus,
            "can_stop": self._can_stop,
            "bundle_id": bundle.bundle_id,
            "card": card_lines(bundle.bundle_id, tau_on, tau_off, provenance, bundle.doubt),
        }

    def view(self) -> dict[str, Any]:
        """The newest view."""
        watch, bundle = self._station.watch, self._bundle
        known = watch.bundle_id == bundle.bundle_id
        watch.thresholds = (
            Thresholds(bundle.thresholds.tau_on, bundle.thresholds.tau_off) if known else Thresholds()
        )  # of another bundle they are not known here
        self._station.look()
        return watch.view(time.monotonic_ns())

    def picture(self, after_ns: int) -> SharedPicture | None:
        """What the bridge on this computer shares, if it is newer."""
        picture = newest_picture(self._shared, time.monotonic_ns())
        return None if picture is None or picture.shared_ns <= after_ns else picture

    async def stop(self) -> str:
        """STOP on the bus; why it failed, empty where it did not."""
        return await self._station.stop()


class RecordedRun:
    """What the server shows of a recording."""

    def __init__(self, playback: Playback) -> None:
        self._playback = playback
        self.view = playback.view
        self.picture = playback.picture

    def about(self) -> dict[str, Any]:
        """What does not change while the page is open."""
        played = self._playback
        return {
            "live": False,
            "title": played.title,
            "can_stop": False,
            "bundle_id": None,
            "card": played.card,
            "length_s": round(played.length_s, 2),
        }


async def watch_bus(bus: str, bundle: Path, access: Access, ready: Told, *, listen_only: bool = False) -> None:
    """Serve a bus until SIGINT or SIGTERM. Raises InputError."""
    codec, end = Codec(), _until_signal()
    own = load_bundle(bundle)
    async with BusPort.open(bus, listen_only=listen_only) as port:
        station = Station(port, Watch(codec, time.monotonic_ns()), codec)
        live = LiveBus(str(port.spec), station, own, can_stop=not listen_only)
        server = Server(access, live=live)
        station.on_change = server.changed
        async with server.serving() as url:
            use_realtime_scheduling(Level.PAGE)  # a STOP from the page must not wait for what is ordinary
            reading = asyncio.create_task(station.run())
            ready(url)
            try:
                done, _ = await asyncio.wait({reading, end}, return_when=asyncio.FIRST_COMPLETED)
                if reading in done:
                    reading.result()
            finally:
                reading.cancel()


async def watch_recording(path: Path, access: Access, ready: Told) -> None:
    """Serve a recording until SIGINT or SIGTERM. Raises InputError."""
    end = _until_signal()
    playback = await asyncio.to_thread(Playback, path)
    async with Server(access, recorded=RecordedRun(playback)).serving() as url:
        ready(url)
        await end


def _until_signal() -> asyncio.Future[None]:
    loop = asyncio.get_running_loop()
    end: asyncio.Future[None] = loop.create_future()

    def finish() -> None:
        if not end.done():
            end.set_result(None)

    for name in (signal.SIGINT, signal.SIGTERM):
        with contextlib.suppress(NotImplementedError, RuntimeError):  # Windows, or not the main thread
            loop.add_signal_handler(name, finish)
    return end
