import pytest

from hilbridge.errors import InputError
from hilbridge.monitor.access import access_of, is_loopback


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("127.0.0.1", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("::", False), ("bench", False)],
)
def test_loopback(host, loopback):
    assert is_loopback(host) is loopback


def test_the_loopback_has_a_secret_of_its_own_each_time():
    one, other = (access_of("127.0.0.1", 0, None, None, None) for _ in range(2))
    assert one.token != other.token
    assert one.url(80) == f"http://127.0.0.1:80/{one.token}/"


def test_elsewhere_it_takes_token_and_tls(pair, token):
    for given in ((None, None, None), (token, None, None), (None, *pair)):
        with pytest.raises(InputError, match=r"--host 0.0.0.0: others reach it"):
            access_of("0.0.0.0", 0, *given)
    access = access_of("0.0.0.0", 8443, token, *pair)
    assert access.url(8443) == f"https://0.0.0.0:8443/{'a' * 32}/"


@pytest.mark.parametrize(("text", "mode"), [("short", 0o600), ("a" * 32, 0o644), ("a b" * 20, 0o600)])
def test_a_weak_token_is_refused(token, text, mode):
    token.write_text(text)
    token.chmod(mode)
    with pytest.raises(InputError, match="--token-file"):
        access_of("127.0.0.1", 0, token, None, None)


def test_half_a_pair_is_refused(pair, tmp_path):
    with pytest.raises(InputError, match="give both"):
        access_of("127.0.0.1", 0, None, pair[0], None)
    with pytest.raises(InputError, match="cannot be used"):
        access_of("127.0.0.1", 0, None, pair[1], tmp_path / "absent")
