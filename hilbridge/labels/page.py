"""A page to label a recording by hand, served to this computer's browser only.

The address holds a secret, so that no other page and no other user of the machine can read a person's pictures through it.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

from mcap.exceptions import McapError
from mcap.reader import make_reader

from hilbridge.errors import InputError
from hilbridge.labels.store import Span, labels_of, put_labels, span_of
from hilbridge.labels.table import label_of, words_at
from hilbridge.observe.parts import recordings_in
from hilbridge.observe.reading import read_recording
from hilbridge.records import Action
from hilbridge.rows import ImageRow, TickRow, decode

_MOST_BODY_BYTES = 4 << 20
_LOOK_BACK_NS = 1_000_000_000  # a picture stands until the next; older than that it is none
_TRACE_NS = 200_000_000


@dataclass(slots=True)
class Session:
    """One recording being labelled."""

    path: Path
    span: Span

    def state(self) -> dict[str, Any]:
        """What the page shows: length, vocabulary, labels, and a trace of confidence and action."""
        trace, next_ns = [], 0
        for row in read_recording(self.path, (TickRow.topic,)):
            if isinstance(row, TickRow) and row.time_ns >= next_ns:
                next_ns = row.time_ns + _TRACE_NS
                trace.append([(row.time_ns - self.span.begin_ns) / 1e6, row.confidence, row.action is Action.ACT])
        return {
            "name": str(self.path),
            "length_ms": (self.span.end_ns - self.span.begin_ns) / 1e6,
            "has_pictures": self.span.first_picture_ns is not None,
            "first_picture_ms": max(0.0, ((self.span.first_picture_ns or 0) - self.span.begin_ns) / 1e6),
            "verbs": words_at(self.path),
            "labels": [asdict(label) for label in labels_of(self.path)],
            "trace": trace,
        }

    def picture(self, at_ms: float) -> bytes | None:
        """The JPEG that was newest at that time, None where there is none."""
        until_ns = self.span.begin_ns + round(at_ms * 1e6)
        for part in reversed(recordings_in([self.path])):
            with part.open("rb") as file:
                found = make_reader(file).iter_messages(
                    [ImageRow.topic], starting_at=max(0, until_ns - _LOOK_BACK_NS), ending_at=until_ns, reverse=True
                )
                for _, channel, message in found:
                    row = decode(channel.topic, message.log_time, message.data)
                    return row.data if isinstance(row, ImageRow) else None
        return None

    def save(self, body: object) -> Path:
        """Check the labels that a page sent and keep them. Raises InputError."""
        if not isinstance(body, list):
            raise InputError("labels: not a list; load the page again")
        labels, words = [], words_at(self.path)
        for number, one in enumerate(body, 1):
            where = f"label {number}"
            if not isinstance(one, dict) or not isinstance(one.get("verb"), str):
                raise InputError(f"{where}: not a label; load the page again")
            try:
                start_ms, end_ms = float(one["start_ms"]), float(one["end_ms"])
            except (KeyError, TypeError, ValueError):
                raise InputError(f"{where}: its times are no numbers; correct them") from None
            labels.append(label_of(start_ms, end_ms, one["verb"], str(one.get("source") or "page")[:80], where, words))
        return put_labels(self.path, labels)


class LabelServer(ThreadingHTTPServer):
    """Serves one session on the loopback. `url` has the secret."""

    daemon_threads = True

    def __init__(self, path: Path, port: int = 0) -> None:
        """Raises InputError for what is no recording, or has no index to find pictures by."""
        self.session = Session(path, span_of(path))
        self.secret = secrets.token_urlsafe(16)
        for part in recordings_in([path]):
            with part.open("rb") as file:
                try:
                    whole = make_reader(file).get_summary() is not None
                except (McapError, ValueError, EOFError):
                    whole = False
            if not whole:
                raise InputError(f"recording {part}: was cut off; make it whole with `hilbridge recover {part}`")
        try:
            super().__init__(("127.0.0.1", port), _Handler)
        except OSError as error:
            raise InputError(f"port {port}: {error.strerror}; choose another with --port") from None

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self.server_port}/{self.secret}/"


class _Handler(BaseHTTPRequestHandler):
    server: LabelServer
    protocol_version = "HTTP/1.1"
    timeout = 30
    _SAFE: ClassVar[Mapping[str, str]] = {
        "Content-Security-Policy": "default-src 'self' 'unsafe-inline'; img-src blob:; frame-ancestors 'none'",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }

    def do_GET(self) -> None:
        """The page, its state, a picture."""
        parts, query = self._asked()
        if parts == [""]:
            page = (files("hilbridge.labels") / "templates" / "label.html").read_bytes()
            self._answer(HTTPStatus.OK, "text/html; charset=utf-8", page)
        elif parts == ["state"]:
            self._answer_json(HTTPStatus.OK, self.server.session.state())
        elif parts == ["picture"]:
            try:
                picture = self.server.session.picture(float(query.get("ms", ["0"])[0]))
            except (ValueError, OverflowError):
                picture = None
            if picture is None:
                self._answer(HTTPStatus.NO_CONTENT, "image/jpeg", b"")
            else:
                self._answer(HTTPStatus.OK, "image/jpeg", picture)
        else:
            self._answer_json(HTTPStatus.NOT_FOUND, {"error": "there is nothing here"})

    def do_POST(self) -> None:
        """Keep the labels that the page sends."""
        parts, _ = self._asked()
        length = self.headers.get("Content-Length", "")
        if parts != ["labels"] or not length.isdigit() or int(length) > _MOST_BODY_BYTES:
            self.close_connection = True
            self._answer_json(HTTPStatus.BAD_REQUEST, {"error": "not a list of labels"})
            return
        try:
            kept = self.server.session.save(json.loads(self.rfile.read(int(length))))
        except (InputError, OSError, ValueError, RecursionError) as error:
            self._answer_json(HTTPStatus.UNPROCESSABLE_ENTITY, {"error": str(error)})
        else:
            self._answer_json(HTTPStatus.OK, {"kept": str(kept)})

    def log_message(self, format: str, *args: object) -> None:
        """Not on the terminal."""

    def _asked(self) -> tuple[list[str] | None, dict[str, list[str]]]:
        """What stands behind the secret, None where the secret is wrong or the page that asks is another's."""
        address = urlsplit(self.path)
        secret, _, rest = address.path.lstrip("/").partition("/")
        own = f"127.0.0.1:{self.server.server_port}"
        if not secrets.compare_digest(secret.encode(), self.server.secret.encode()) or self.headers.get("Host") != own:
            return None, {}
        return rest.split("/"), parse_qs(address.query)

    def _answer_json(self, status: HTTPStatus, value: object) -> None:
        self._answer(status, "application/json", json.dumps(value).encode())

    def _answer(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        for name, value in self._SAFE.items():
            self.send_header(name, value)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)
