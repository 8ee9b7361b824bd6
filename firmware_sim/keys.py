"""The shared key on the device: from a file nobody else can read, or the demo key, which no physical bus may carry."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from firmware_sim.secoc import DEMO_KEY

KEY_LENGTH = 16


WRONG = bytes(range(16, 32))  # what a device with another key has, as a fault


class KeyUnusable(ValueError):
    """The key cannot be used; the message is one line naming the file and the cure."""


def load_key(path: Path | None, *, physical: bool) -> bytes:
    """The 16-byte key: 32 hexadecimal digits in a file of mode 0600, or the demo key where `path` is None.

    Raises KeyUnusable: file missing, readable by others, not a key, or the demo key on a physical bus.
    """
    if path is None:
        key = DEMO_KEY
    else:
        try:
            mode = path.stat().st_mode
            text = path.read_text(encoding="ascii").strip()
        except FileNotFoundError:
            raise KeyUnusable(f"{path}: no such key file; make one with `openssl rand -hex 16 > {path}`") from None
        except (OSError, UnicodeDecodeError) as error:
            raise KeyUnusable(f"{path}: key file cannot be read ({error})") from None
        if os.name == "posix" and stat.S_IMODE(mode) & 0o077:
            raise KeyUnusable(f"{path}: key file is open to others; run `chmod 600 {path}`")
        try:
            key = bytes.fromhex(text)
        except ValueError:
            key = b""
        if len(key) != KEY_LENGTH:
            raise KeyUnusable(f"{path}: not a key; it holds 32 hexadecimal digits (`openssl rand -hex 16`)")
    if physical and key == DEMO_KEY:
        raise KeyUnusable("the demo key is public and refused on a physical bus; give a key with --key-file")
    return key
