import json
import ssl

import pytest

aiohttp = pytest.importorskip("aiohttp")

from hilbridge.errors import InputError  # noqa: E402
from hilbridge.monitor.access import Access, access_of  # noqa: E402
from hilbridge.monitor.server import Server  # noqa: E402
from hilbridge.observe.keeping.sharing import SharedPicture  # noqa: E402


class Shown:
    """A bus that counts stops."""

    def __init__(self):
        self.stops = 0

    def about(self):
        return {"live": True}

    def view(self):
        return {"s": 1.0}

    def picture(self, after_ns):
        return SharedPicture(8, 64, 36, b"\xff\xd8", (0.5, 0.25)) if after_ns < 8 else None

    async def stop(self):
        self.stops += 1
        return ""


class Moments:
    def about(self):
        return {"live": False}

    def view(self, at_s):
        return {"s": at_s}

    def picture(self, at_s):
        return SharedPicture(8, 64, 36, b"\xff\xd8") if at_s > 1 else None


def here() -> Access:
    return access_of("127.0.0.1", 0, None, None, None)


@pytest.fixture
async def client():
    async with aiohttp.ClientSession() as session:
        yield session


async def test_page_files_and_headers(client):
    async with Server(here(), live=Shown()).serving() as url:
        for name, kind in (("", "text/html"), ("page.js", "text/javascript"), ("page.css", "text/css")):
            async with client.get(url + name) as answer:
                assert (answer.status, answer.content_type) == (200, kind)
                assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
                assert answer.headers["Referrer-Policy"] == "no-referrer"
        async with client.get(url + "about") as answer:
            assert await answer.json() == {"live": True}


@pytest.mark.parametrize("name", ["", "about", "live", "page.js"])
async def test_without_the_secret_there_is_nothing(client, name):
    access = here()
    async with Server(access, live=Shown()).serving() as url:
        async with client.get(url.replace(access.token, "x" * 22) + name) as answer:
            assert answer.status == 404
        async with client.get(url + name, headers={"Origin": "http://elsewhere"}) as answer:
            assert answer.status == 404


async def test_views_come_and_only_the_word_stop_does_anything(client):
    shown = Shown()
    async with Server(here(), live=shown).serving() as url, client.ws_connect(url + "live") as socket:
        assert (await socket.receive_json()).keys() <= {"s"}
        for other in ("stop", "ACT", "", "STOP ", "STOPSTOP", '{"stop": 1}', "0x060#" + "00" * 8, "é" * 100):
            await socket.send_str(other)
        await socket.send_bytes(b"STOP")
        await socket.send_str("STOP")
        while "stop" not in (told := await socket.receive_json()):
            pass
        assert (told, shown.stops) == ({"stop": ""}, 1)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
async def test_nothing_can_be_put_there(client, method):
    shown = Shown()
    async with Server(here(), live=shown).serving() as url:
        for name in ("live", "stop", ""):
            async with client.request(method, url + name, data="STOP") as answer:
                assert answer.status in (404, 405)
    assert shown.stops == 0


async def test_two_clients_see_the_same_and_one_may_leave(client):
    async with (
        Server(here(), live=Shown()).serving() as url,
        client.ws_connect(url + "live") as one,
        client.ws_connect(url + "live") as two,
    ):
        for socket in (one, two):
            while json.loads(await socket.receive_str()) != {"s": 1.0}:
                pass
        await one.close()
        assert await two.receive_json() == {"s": 1.0}


async def test_a_shared_picture_comes_once_with_what_is_drawn_over_it(client):
    async with Server(here(), live=Shown()).serving() as url:
        for asked, status in (("0", 200), ("7", 200), ("8", 204), ("-1", 200), ("x", 200), ("9" * 30, 200)):
            async with client.get(f"{url}picture?after={asked}") as answer:
                assert answer.status == status
                if status == 200:
                    assert (answer.content_type, await answer.read()) == ("image/jpeg", b"\xff\xd8")
                    seen = {"number": "8", "width": 64, "height": 36, "gaze": [0.5, 0.25], "hands": []}
                    assert json.loads(answer.headers["X-Overlay"]) == seen


async def test_a_recording_has_moments_and_no_socket(client):
    async with Server(here(), recorded=Moments()).serving() as url:
        for asked, s in (("2.5", 2.5), ("x", 0.0), ("nan", 0.0)):
            async with client.get(f"{url}view?s={asked}") as answer:
                assert await answer.json() == {"s": s}
        statuses = []
        for name in ("picture?s=2", "picture?s=0", "live"):
            async with client.get(url + name) as answer:
                statuses.append(answer.status)
        assert statuses == [200, 204, 404]


async def test_a_port_that_is_taken_is_said_in_a_line():
    async with Server(here(), live=Shown()).serving() as url:
        port = int(url.split(":")[2].split("/")[0])
        with pytest.raises(InputError, match="choose another with --port"):
            async with Server(access_of("127.0.0.1", port, None, None, None), live=Shown()).serving():
                pass


async def test_tls_serves_page_and_stop_to_whoever_knows_the_token_and_to_nobody_without(client, pair, token):
    shown, trusted = Shown(), ssl.create_default_context(cafile=str(pair[0]))
    async with Server(access_of("127.0.0.1", 0, token, *pair), live=shown).serving() as url:
        assert url.startswith("https://127.0.0.1:")
        async with client.get(url, ssl=trusted) as answer:
            assert answer.status == 200
        async with client.ws_connect(url + "live", ssl=trusted, origin=url.rsplit("/", 2)[0]) as socket:
            await socket.send_str("STOP")
            while "stop" not in await socket.receive_json():
                pass
        for wrong in (url.replace("a" * 32, "b" * 32), url.replace("a" * 32, ""), url.rsplit("/", 2)[0] + "/"):
            async with client.get(wrong + "live", ssl=trusted) as answer:
                assert answer.status == 404  # not 401: that would say that there is something
        with pytest.raises(aiohttp.ClientError):  # whoever speaks no TLS
            await client.get(url.replace("https", "http"))
        with pytest.raises(aiohttp.ClientConnectorCertificateError):  # a certificate that the client does not know
            await client.get(url)
    assert shown.stops == 1
