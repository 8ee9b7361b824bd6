"""Monitor and pages for long, in short: `python -m tests.tools.operator.page_soak --minutes 30` is the whole."""

from __future__ import annotations

import os

import pytest

from tests.system.operator.rig import CHROMIUM

pytest.importorskip("playwright.sync_api", reason="playwright is not installed: no browser test")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine: the page is not tried")


def test_nothing_grows_while_two_pages_watch_and_the_monitor_starts_again(monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.tools.operator.page_soak import soak

    monkeypatch.setenv("XDG_RUNTIME_DIR", os.environ.get("XDG_RUNTIME_DIR", ""))  # the soak sets its own
    grown = soak(minutes=0.7, every_s=1.0)
    assert grown.judge() == []
    assert grown.reloads > 0
    assert grown.pictures > 5
