"""Who may see the page and press STOP: whoever knows the secret in its address; from another computer only through TLS."""

from __future__ import annotations

import ipaddress
import re
import secrets
import ssl
import stat
from dataclasses import dataclass
from pathlib import Path

from hilbridge.errors import InputError

_TOKEN = re.compile(r"[A-Za-z0-9_-]{22,128}")


@dataclass(frozen=True, slots=True)
class Access:
    """Where the page is served. tls: None on the loopback only."""

    host: str
    port: int
    token: str
    tls: ssl.SSLContext | None = None

    def url(self, port: int) -> str:
        """The page's address, its secret included."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.tls else 'http'}://{host}:{port}/{self.token}/"


def is_loopback(host: str) -> bool:
    """Whether only this computer reaches the address. A name other than `localhost` may lead anywhere."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def access_of(
    host: str, port: int, token_file: Path | None, certificate: Path | None, certificate_key: Path | None
) -> Access:
    """Raises InputError: beyond the loopback it takes a token of one's own and TLS."""
    tls = _tls(certificate, certificate_key)
    if not is_loopback(host):
        if tls is None:
            raise InputError(
                f"--host {host}: others reach it, so it needs TLS; add --certificate and --certificate-key"
            )
        if token_file is None:
            raise InputError(f"--host {host}: others reach it, so it needs a token; add --token-file FILE (mode 0600)")
    return Access(host, port, secrets.token_urlsafe(16) if token_file is None else _token(token_file), tls)


def _token(path: Path) -> str:
    try:
        token, mode = path.read_text(encoding="utf-8").strip(), path.stat().st_mode
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"--token-file {path}: cannot be read ({error}); check the name") from None
    if stat.S_IMODE(mode) & 0o077:
        raise InputError(f"--token-file {path}: others may read it; `chmod 600 {path}`")
    if not _TOKEN.fullmatch(token):
        raise InputError(
            f"--token-file {path}: not 22 to 128 letters, digits, - or _; "
            "`python -c 'import secrets; print(secrets.token_urlsafe(32))'` makes one"
        )
    return token


def _tls(certificate: Path | None, key: Path | None) -> ssl.SSLContext | None:
    if certificate is None and key is None:
        return None
    if certificate is None or key is None:
        raise InputError("--certificate and --certificate-key belong together; give both")
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise InputError(f"--certificate {certificate}: cannot be used ({error}); give a PEM pair") from None
    return context
