"""Keys of the bridge: the demo key and key files."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from hilbridge.errors import InputError

# Printed in the sources, therefore worth nothing: refused on a physical bus.
DEMO_KEY = b"hilbridge-demo-k"

KEY_LENGTH = 16


class KeyFileError(InputError):
    """The key cannot be used; the message is one line naming the file and the cure."""


def load_key(path: Path | None, *, physical: bool) -> bytes:
    """The 16-byte key: 32 hexadecimal digits in a file of mode 0600, or the demo key where `path` is None.

    Raises KeyFileError: file missing, unreadable, open to others, not a key, or the demo key on a physical bus.
    """
    key = DEMO_KEY if path is None else _read_key(path)
    if physical and key == DEMO_KEY:
        raise KeyFileError(
            "the demo key is public and refused on a physical bus; make one with "
            "`(umask 077; openssl rand -hex 16 > arm.key)` and name it as key file on both sides"
        )
    return key


def _read_key(path: Path) -> bytes:
    try:
        mode = path.stat().st_mode
        text = path.read_text(encoding="ascii").strip()
    except FileNotFoundError:
        raise KeyFileError(
            f"{path}: no such key file; make one with `(umask 077; openssl rand -hex 16 > {path})`"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise KeyFileError(f"{path}: key file cannot be read ({error})") from None
    if os.name == "posix" and stat.S_IMODE(mode) & 0o077:
        raise KeyFileError(f"{path}: key file is open to others; run `chmod 600 {path}`")
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    if len(key) != KEY_LENGTH:
        raise KeyFileError(f"{path}: not a key; it holds 32 hexadecimal digits (`openssl rand -hex 16`)")
    return key
