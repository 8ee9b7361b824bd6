"""The pictures in the documents: `python -m tests.tools.pictures_of_pages`. The demo's report and live page, in Chromium."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.system.operator.rig import chromium, monitor

IMAGES = Path(__file__).parents[2] / "docs" / "images"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def photograph(page: Path, picture: Path, width_px: int, height_px: int) -> None:
    """A page as a person sees it. Raises SystemExit where there is no browser."""
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        raise SystemExit(f"none of {', '.join(BROWSERS)} is installed: apt-get install chromium")
    command = [
        browser,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--virtual-time-budget=4000",
    ]
    command += [f"--window-size={width_px},{height_px}", f"--screenshot={picture}", page.resolve().as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=120)


def photograph_live(folder: Path, picture: Path) -> None:
    """The operator's page while the demo assists, with the simulated wearer's picture."""
    bus = f"hilsim:pictures-{os.getpid()}"
    command = [
        sys.executable,
        "-m",
        "hilbridge",
        "demo",
        "--seconds",
        "60",
        "--bus",
        bus,
        "--out",
        str(folder),
        "--open",
    ]
    unseen = {
        **os.environ,
        "BROWSER": "true %s",
    }  # it shares its picture where it opens the page: nobody need see that one
    silent = subprocess.DEVNULL
    with (
        subprocess.Popen(command, env=unseen, stdout=silent, stderr=silent) as demo,
        monitor("--bus", bus) as (url, _),
        chromium() as browser,
    ):
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto(url)
        page.wait_for_selector("#overlay .gaze", timeout=60_000)
        page.wait_for_timeout(15_000)  # for a trace to look at
        page.wait_for_selector("#state.assist", timeout=60_000)
        page.screenshot(path=picture, full_page=True)
        demo.terminate()


def main() -> int:
    """Make them anew."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name, "demo")
        command = [sys.executable, "-m", "hilbridge", "demo", "--seconds", "30", "--out", str(folder), "--json"]
        subprocess.run(command, check=True, capture_output=True, timeout=300)
        photograph(folder / "report.html", IMAGES / "demo.png", 1000, 1100)
        photograph_live(Path(name, "live"), IMAGES / "monitor.png")
    print(IMAGES / "demo.png", IMAGES / "monitor.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
