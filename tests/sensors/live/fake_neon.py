"""A phone with a Neon as the vendor's client expects it: status over HTTP, time echo, gaze over RTSP with sender reports.

It lives in a thread of its own. `skew_ns` sets its clock; `silent` blackholes it: sockets stay open, nothing comes out.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import struct
import threading
import time
from dataclasses import dataclass, field

from aiohttp import web
from aiortsp.rtcp.parser import RTCP, SR

from tests.sensors.live import fake_world

CLOCK_HZ = 90_000
SDP = (
    "v=0\r\no=- 1 1 IN IP4 127.0.0.1\r\ns=gaze\r\nt=0 0\r\n"
    "m=application 0 RTP/AVP 96\r\na=rtpmap:96 com.pupillabs.gaze1/90000\r\na=control:*\r\n"
)


@dataclass
class FakeNeon:
    version: str = "2"
    period_s: float = 0.01
    x: float = 800.0
    y: float = 600.0
    worn: bool = True
    lids_mm: float | None = None  # aperture of both lids; None: the short packet
    connected: bool = True
    silent: bool = False
    skew_ns: int = 250_000_000
    port: int = 0
    echo_port: int = 0
    rtsp_port: int = 0
    sent: int = 0
    pictures_ns: list[int] = field(default_factory=list)
    _loop: asyncio.AbstractEventLoop = field(default_factory=asyncio.new_event_loop)
    _stop: asyncio.Event = field(default_factory=asyncio.Event)
    _writers: set[asyncio.StreamWriter] = field(default_factory=set)

    def __enter__(self) -> FakeNeon:
        ready = threading.Event()
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._serve(ready),), daemon=True)
        self._thread.start()
        assert ready.wait(20)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(20)
        self._loop.close()

    def again(self) -> FakeNeon:
        """The same phone, started anew."""
        return FakeNeon(
            self.version, skew_ns=self.skew_ns, port=self.port, echo_port=self.echo_port, rtsp_port=self.rtsp_port
        )

    def wall_ns(self) -> int:
        return time.time_ns() + self.skew_ns

    async def _serve(self, ready: threading.Event) -> None:
        app = web.Application()
        app.router.add_get("/api/status", self._status)
        runner = web.AppRunner(app, shutdown_timeout=0.1)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", self.port, reuse_address=True)
        await site.start()
        self.port = runner.addresses[0][1]
        echo = await asyncio.start_server(self._echo, "127.0.0.1", self.echo_port)
        self.echo_port = echo.sockets[0].getsockname()[1]
        rtsp = await asyncio.start_server(self._rtsp, "127.0.0.1", self.rtsp_port)
        self.rtsp_port = rtsp.sockets[0].getsockname()[1]
        ready.set()
        await self._stop.wait()
        echo.close()
        rtsp.close()
        for writer in self._writers:
            writer.close()
        await runner.cleanup()
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _status(self, request: web.Request) -> web.Response:
        while self.silent:
            await asyncio.sleep(0.05)
        phone = {
            "battery_level": 90, "battery_state": "OK", "device_id": "1", "device_name": "phone", "ip": "127.0.0.1",
            "memory": 10**9, "memory_state": "OK", "time_echo_port": self.echo_port,
        }  # fmt: skip
        gaze = {
            "sensor": "gaze", "conn_type": "DIRECT", "connected": self.connected, "ip": "127.0.0.1",
            "params": "camera=gaze", "port": self.rtsp_port, "protocol": "rtsp", "stream_error": False,
        }  # fmt: skip
        world = gaze | {"sensor": "world", "params": "camera=world"}
        hardware = {"version": self.version}
        found = [("Phone", phone), ("Hardware", hardware), ("Sensor", gaze), ("Sensor", world)]
        return web.json_response({"result": [{"model": model, "data": data} for model, data in found]})

    async def _echo(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            while True:
                asked = await reader.readexactly(8)
                if not self.silent:
                    writer.write(asked + struct.pack("!Q", self.wall_ns() // 1_000_000))

    async def _rtsp(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        client, stream = (0, 0), None
        try:
            while True:
                request = (await reader.readuntil(b"\r\n\r\n")).decode()
                if self.silent:
                    continue
                method = request.split(" ", 1)[0]
                headers = dict(line.split(": ", 1) for line in request.split("\r\n")[1:] if ": " in line)
                more, body = "Session: 7;timeout=60\r\n", ""
                if method == "OPTIONS":
                    more += "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
                elif method == "DESCRIBE":
                    body = fake_world.SDP if "camera=world" in request else SDP
                    more += f"Content-Type: application/sdp\r\nContent-Length: {len(body)}\r\n"
                elif method == "SETUP":
                    if "interleaved" in headers["Transport"]:
                        client = (0, 0)
                        more += f"Transport: {headers['Transport']}\r\n"
                        writer.write(f"RTSP/1.0 200 OK\r\nCSeq: {headers['CSeq']}\r\n{more}\r\n".encode())
                        continue
                    ports = headers["Transport"].rpartition("client_port=")[2].split("-")
                    client = (int(ports[0]), int(ports[1]))
                    more += f"Transport: {headers['Transport']}\r\n"
                writer.write(f"RTSP/1.0 200 OK\r\nCSeq: {headers['CSeq']}\r\n{more}\r\n{body}".encode())
                if method == "PLAY" and client == (0, 0):
                    send = fake_world.world(writer, self.wall_ns, lambda: self.silent, self.pictures_ns)
                    stream = asyncio.create_task(send)
                elif method == "PLAY":
                    stream = asyncio.create_task(self._stream(*client))
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            pass
        finally:
            if stream is not None:
                stream.cancel()
            writer.close()

    async def _stream(self, rtp_port: int, rtcp_port: int) -> None:
        loop = asyncio.get_running_loop()
        rtp, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=("127.0.0.1", rtp_port))
        rtcp, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=("127.0.0.1", rtcp_port))
        try:
            for count in itertools.count():
                now_ns = time.monotonic_ns()
                ticks = now_ns * CLOCK_HZ // 1_000_000_000 % 2**32
                if not self.silent:
                    if count % 50 == 0:  # the report carries the phone's clock as it is set now
                        rtcp.sendto(bytes(RTCP([SR(7, self.wall_ns() / 1e9, ticks)])))
                    header = struct.pack("!BBHII", 0x80, 96, count % 2**16, ticks, 7)
                    rtp.sendto(header + self._payload())
                    self.sent += 1
                await asyncio.sleep(self.period_s)
        finally:
            rtp.close()
            rtcp.close()

    def _payload(self) -> bytes:
        short = struct.pack("!ffB", self.x, self.y, 255 if self.worn else 0)
        if self.lids_mm is None:
            return short
        lids = (0.3, -0.3, self.lids_mm)
        return short + struct.pack("!14f", *[1.0] * 14) + struct.pack("!6f", *lids, *lids)
