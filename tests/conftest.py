"""What every room's tests share: where the real input is, and that CI may not do without it."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

# A busy machine is no failure: nothing here is judged by the time it took.
settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")

# A shell that starts the tests in the background has them ignore Ctrl-C, and so would the programs whose Ctrl-C is tested.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real input that HILBRIDGE_TEST_DATA names. Absent: the test skips, saying so; in CI it fails."""
    folder = os.environ.get("HILBRIDGE_TEST_DATA")
    if folder and Path(folder).is_dir():
        return Path(folder).resolve()
    message = f"HILBRIDGE_TEST_DATA names no folder ({folder or 'unset'}): real input is not here"
    if os.environ.get("CI"):
        pytest.fail(message)
    pytest.skip(message)
