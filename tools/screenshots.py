"""Takes pictures of the live view in a real browser, for the documentation.

    python -m tools.screenshots [SCENARIO] [--after SECONDS]

Flies the scenario with `uuv-hil demo --view`, opens the view in Debian's Chromium, and writes
docs/how-to/live_view.png and live_view_dark.png. Needs the extra dev, and chromium.
"""

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from hil.common.ports import free_ports

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "docs" / "how-to"
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"]
PATIENCE_MS = 180_000


def take(address: str, seconds: float) -> list[Path]:
    """Take both pictures `seconds` after the view was opened; their files."""
    from playwright.sync_api import sync_playwright

    files = [FOLDER / "live_view.png", FOLDER / "live_view_dark.png"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=OPTIONS)
        for file, scheme in zip(files, ("light", "dark"), strict=True):
            page = browser.new_page(viewport={"width": 1400, "height": 860})
            page.goto(address, timeout=PATIENCE_MS)
            frame = page.frame_locator("#scene")
            frame.get_by_text("Pictures").first.wait_for(timeout=PATIENCE_MS)
            if scheme == "dark":
                frame.get_by_role("checkbox").first.check(force=True)
            page.wait_for_timeout(1000.0 * seconds)
            notice = frame.locator(".mantine-Notification-closeButton")  # on a browser without a graphics card
            if notice.count():
                notice.first.click(force=True)
            page.screenshot(path=file, timeout=PATIENCE_MS)
            page.close()
        browser.close()
    return files


def main() -> None:
    """Fly, look, and write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="?", default="paper_field")
    parser.add_argument("--after", type=float, default=15.0, metavar="SECONDS", help="[%(default)g]")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "hil.cli", "demo", options.scenario, "--view", "--output", folder]
        command += ["--listen", f"tcp/127.0.0.1:{free_ports(1)[0]}"]
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as demo:
            assert demo.stdout
            found = re.search(r"http://\S+", demo.stdout.readline())
            assert found, "the demo has no view"
            try:
                print(*take(found[0], options.after), sep="\n")
            finally:
                demo.terminate()
                demo.communicate()


if __name__ == "__main__":
    main()
