"""run: what a run leaves behind where it ends before it has begun."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from hilbridge import run as module
from hilbridge.config import Config
from hilbridge.rows import TickRow
from hilbridge.runtime.assemble import read_parts


class Silent:
    def tick(self, seconds: float, row: TickRow) -> None: ...

    def notice(self, text: str) -> None: ...

    def over(self, text: str) -> None: ...


async def test_an_interrupt_while_the_bus_opens_leaves_a_whole_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @asynccontextmanager
    async def interrupted(*arguments: Any, **more: Any) -> AsyncIterator[None]:
        raise asyncio.CancelledError  # what asyncio makes of a Ctrl-C
        yield

    monkeypatch.setattr(module, "live_bridge", interrupted)
    config, senses = Config(), object()
    with pytest.raises(asyncio.CancelledError):
        await module.run_bridge(config, read_parts(config), senses, tmp_path, module.RunOptions("x"), Silent())  # type: ignore[arg-type]  # none are opened
    with (tmp_path / module.RECORDING).open("rb") as file:
        assert make_reader(file).get_summary() is not None
