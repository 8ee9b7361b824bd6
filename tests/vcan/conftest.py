"""Everything here needs a kernel bus vcan0; without one a plain pytest run says so and skips, the runner fails."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark this folder's tests; skip them outside the runner where there is no vcan0."""
    present = Path("/sys/class/net/vcan0").exists()
    if not present and os.environ.get("HILBRIDGE_VCAN_RUNNER"):
        pytest.exit("tests/vcan/run started these tests, yet there is no vcan0", returncode=1)
    for item in items:
        if HERE not in item.path.parents:
            continue
        item.add_marker(pytest.mark.vcan)
        if not present:
            item.add_marker(
                pytest.mark.skip(reason="no vcan0 here; `tests/vcan/run PYTHON` boots a kernel that has one")
            )


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Show a failure at once: what stops the whole kernel later must not take it along."""
    if report.failed and os.environ.get("HILBRIDGE_VCAN_RUNNER") and HERE.name in report.nodeid:
        print(f"\n{report.nodeid} ({report.when}):\n{report.longreprtext}", flush=True)
