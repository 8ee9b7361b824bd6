import json
import threading
import urllib.error
import urllib.request
from contextlib import contextmanager

import pytest

from hilbridge.errors import InputError
from hilbridge.labels.page import LabelServer
from hilbridge.labels.store import labels_of
from tests.labels.made import recording


@contextmanager
def serving(path):
    with LabelServer(path) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def get(url, body=None, **headers):
    request = urllib.request.Request(url, data=body, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=30) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


def test_page_state_pictures_and_labels(tmp_path):
    path = recording(tmp_path / "recording.mcap")
    with serving(path) as server:
        status, headers, page = get(server.url)
        assert (status, headers["X-Content-Type-Options"]) == (200, "nosniff")
        assert b"<title>Labels</title>" in page
        state = json.loads(get(server.url + "state")[2])
        assert (state["has_pictures"], state["labels"], len(state["verbs"])) == (True, [], 22)
        assert state["length_ms"] == 149 * 40
        assert len(state["trace"]) == 30
        assert get(server.url + "picture?ms=0")[0] == 204
        assert get(server.url + "picture?ms=1000")[2][:2] == b"\xff\xd8"
        for wrong in ("nan", "x", "1e400", "-5"):
            assert get(server.url + f"picture?ms={wrong}")[0] == 204
        status, _, told = get(
            server.url + "labels", json.dumps([{"start_ms": 40, "end_ms": 900, "verb": "Cut"}]).encode()
        )
        assert (status, "recording.labels.csv" in told.decode()) == (200, True)
        assert get(server.url + "picture?ms=1000")[0] == 200
    (label,) = labels_of(path)
    assert (label.start_ms, label.end_ms, label.verb, label.source) == (40, 900, "Cut", "page")


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{}",
        b"[1]",
        b'[{"verb": "Cut"}]',
        b'[{"verb": "Cut", "start_ms": "x", "end_ms": 2}]',
        b'[{"verb": "Fly", "start_ms": 1, "end_ms": 2}]',
        b'[{"verb": "Cut", "start_ms": 1e999, "end_ms": 2}]',
        b'[{"verb": "Cut", "start_ms": 1, "end_ms": 99999999}]',
        b"[" * 100_000,
    ],
)
def test_what_is_no_list_of_labels_is_refused_and_changes_nothing(tmp_path, body):
    path = recording(tmp_path / "recording.mcap")
    before = path.read_bytes()
    with serving(path) as server:
        status, _, told = get(server.url + "labels", body)
    assert status == 422
    assert json.loads(told)["error"]
    assert path.read_bytes() == before


def test_nobody_without_the_secret_sees_a_person(tmp_path):
    with serving(recording(tmp_path / "recording.mcap")) as server:
        base = f"http://127.0.0.1:{server.server_port}/"
        for url in (base, base + "state", base + "wrong/state", base + "picture?ms=1000"):
            assert get(url)[0] == 404
        assert get(server.url + "state", Host="evil.example")[0] == 404
        assert get(base + "wrong/labels", b"[]")[0] == 400


def test_a_recording_without_its_end_is_to_be_recovered_first(tmp_path):
    path = recording(tmp_path / "recording.mcap")
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(InputError, match="hilbridge recover"):
        LabelServer(path)
