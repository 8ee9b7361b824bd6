"""The pictures in the documents: `python -m tests.tools.pictures_of_pages`. The demo's report, in Chromium."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

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


def main() -> int:
    """Make them anew."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name, "demo")
        command = [sys.executable, "-m", "hilbridge", "demo", "--seconds", "30", "--out", str(folder), "--json"]
        subprocess.run(command, check=True, capture_output=True, timeout=300)
        photograph(folder / "report.html", IMAGES / "demo.png", 1000, 1100)
    print(IMAGES / "demo.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
