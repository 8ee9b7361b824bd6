"""The page's server: views are pushed over a WebSocket, five a second, and at once where something changed. The one word
that it understands is STOP.

A WebSocket, because a browser opens only six ordinary connections to one server: a page in a seventh tab could not stop.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Protocol

from hilbridge.errors import InputError, needs_extra
from hilbridge.monitor.access import Access
from hilbridge.observe.keeping.sharing import SharedPicture

with needs_extra("monitor"):
    from aiohttp import WSCloseCode, WSMsgType, web

STOP = "STOP"
LEAST_GAP_S = 0.05  # where what a person must see at once has changed
LONGEST_GAP_S = 0.2
_MOST_CLIENTS = 32
_PATIENCE_S = 5.0  # for a client that does not read
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_FILES = {"": ("monitor.html", "text/html"), "page.js": ("monitor.js", "text/javascript")}
_FILES["page.css"] = ("monitor.css", "text/css")

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Live(Protocol):
    """What the server shows of a bus, and how it stops."""

    def about(self) -> dict[str, Any]:
        """What does not change while the page is open."""

    def view(self) -> dict[str, Any]:
        """The newest view."""

    def picture(self, after_ns: int) -> SharedPicture | None:
        """The bridge's newest picture, if it shares them and this one is newer."""

    async def stop(self) -> str:
        """STOP on the bus; why it failed, empty where it did not."""


class Recorded(Protocol):
    """What the server shows of a recording."""

    def about(self) -> dict[str, Any]:
        """What does not change while the page is open."""

    def view(self, at_s: float) -> dict[str, Any]:
        """The view of a moment."""

    def picture(self, at_s: float) -> SharedPicture | None:
        """The picture of a moment, and what was seen in it."""


@dataclass(slots=True)
class _Newest:
    """The newest view as text, numbered; clients wait for a higher number."""

    number: int = 0
    text: str = ""


class Server:
    """Serves one bus or one recording."""

    def __init__(self, access: Access, live: Live | None = None, recorded: Recorded | None = None) -> None:
        self._access = access
        self._live = live
        self._recorded = recorded
        self._newest = _Newest()
        self._arrived = asyncio.Condition()
        self._changed = asyncio.Event()
        self._clients: set[web.WebSocketResponse] = set()

    def changed(self) -> None:
        """Push as soon as the rate allows."""
        self._changed.set()

    @contextlib.asynccontextmanager
    async def serving(self) -> AsyncIterator[str]:
        """Serve inside; gives the page's address. Raises InputError where the address is taken."""
        app = web.Application(middlewares=[self._guard], client_max_size=1024)
        app.router.add_get("/{token}/{name:[a-z.]*}", self._get)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        producer = asyncio.create_task(self._produce()) if self._live is not None else None
        try:
            site = web.TCPSite(runner, self._access.host, self._access.port, ssl_context=self._access.tls)
            try:
                await site.start()
            except OSError as error:
                where = f"{self._access.host} port {self._access.port}"
                raise InputError(f"{where}: {error.strerror or error}; choose another with --port") from None
            yield self._access.url(runner.addresses[0][1])
        finally:
            if producer is not None:
                producer.cancel()
            for client in set(self._clients):
                with contextlib.suppress(Exception):
                    await client.close(code=WSCloseCode.GOING_AWAY)
            await runner.cleanup()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Nothing without the secret, and nothing that another site's page asks for."""
        token = request.match_info.get("token", "")
        origin = request.headers.get("Origin")
        own = f"{request.scheme}://{request.host}"
        known = secrets.compare_digest(token.encode(), self._access.token.encode())
        if not known or (origin is not None and origin != own):
            return web.json_response({"error": "there is nothing here"}, status=404, headers=_HEADERS)
        return await handler(request)

    async def _get(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        if name in _FILES:
            file, kind = _FILES[name]
            body = (files("hilbridge.monitor") / "templates" / file).read_bytes()
            return web.Response(body=body, content_type=kind, charset="utf-8", headers=_HEADERS)
        if name == "about":
            shown = self._live if self._live is not None else self._recorded
            return web.json_response({} if shown is None else shown.about(), headers=_HEADERS)
        if name == "live" and self._live is not None:
            return await self._socket(request, self._live)
        if name == "picture" and self._live is not None:
            return await self._shared(request, self._live)
        if name in ("view", "picture") and self._recorded is not None:
            return await self._moment(name, request, self._recorded)
        return web.json_response({"error": "there is nothing here"}, status=404, headers=_HEADERS)

    async def _moment(self, name: str, request: web.Request, recorded: Recorded) -> web.StreamResponse:
        try:
            at_s = float(request.query.get("s", "0"))
        except ValueError:
            at_s = 0.0
        at_s = at_s if at_s == at_s else 0.0  # not a number
        if name == "view":
            return web.json_response(await asyncio.to_thread(recorded.view, at_s), headers=_HEADERS)
        return _picture(await asyncio.to_thread(recorded.picture, at_s))

    async def _shared(self, request: web.Request, live: Live) -> web.StreamResponse:
        """The bridge's picture, if it is one that the page has not got."""
        after = request.query.get("after", "0")
        picture = await asyncio.to_thread(live.picture, int(after) if after.isdecimal() and len(after) < 20 else 0)
        return _picture(picture)

    async def _socket(self, request: web.Request, live: Live) -> web.StreamResponse:
        if len(self._clients) >= _MOST_CLIENTS:
            return web.json_response({"error": f"{_MOST_CLIENTS} pages are open already"}, status=503, headers=_HEADERS)
        socket = web.WebSocketResponse(heartbeat=10.0, max_msg_size=256, compress=False)  # a STOP waits for no packing
        await socket.prepare(request)
        self._clients.add(socket)
        pusher = asyncio.create_task(self._push(socket))
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT and message.data == STOP:
                    failure = await live.stop()
                    self.changed()
                    await socket.send_str(json.dumps({"stop": failure}))
        except (TimeoutError, ConnectionError):
            pass
        finally:
            pusher.cancel()
            self._clients.discard(socket)
        return socket

    async def _push(self, socket: web.WebSocketResponse) -> None:
        seen = 0
        try:
            while not socket.closed:
                async with self._arrived:
                    while self._newest.number <= seen:
                        await self._arrived.wait()
                seen = self._newest.number
                async with asyncio.timeout(_PATIENCE_S):
                    await socket.send_str(self._newest.text)
        except (ConnectionError, TimeoutError):
            await socket.close()

    async def _produce(self) -> None:
        assert self._live is not None
        while True:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(LONGEST_GAP_S - LEAST_GAP_S):
                    await self._changed.wait()
            self._changed.clear()
            view = self._live.view()
            async with self._arrived:
                self._newest = _Newest(self._newest.number + 1, json.dumps(view) if self._clients else "{}")
                self._arrived.notify_all()
            await asyncio.sleep(LEAST_GAP_S)


def _picture(picture: SharedPicture | None) -> web.Response:
    """A JPEG, and in a header what the page draws over it; 204 where there is none."""
    if picture is None:
        return web.Response(status=204, headers=_HEADERS)
    overlay = json.dumps({"number": str(picture.shared_ns), **picture.overlay})
    return web.Response(body=picture.jpeg, content_type="image/jpeg", headers={**_HEADERS, "X-Overlay": overlay})
