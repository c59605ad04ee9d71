"""Take pictures of the live view in a real browser, for the documentation.

    python -m tools.pages.screenshots [SCENARIO | CHART.000] [--speed M/S] [--after SECONDS]
    python -m tools.pages.screenshots --pictures

It flies slowly with `uuv-hil demo --view`, opens the view in Debian's Chromium, and writes docs/how-to/live_view.png.
A second flight is for live_view_dark.png. Over a chart the vehicle has a camera and a sonar. `--pictures` flies along a
pier of the installed harbour and writes live_view_pictures.png, with the pictures of camera, forward sonar and side
scan. Needs the extra dev, and chromium. Without a graphics card a browser takes a minute or more to draw the scene:
give it a high priority.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Literal

from hil.charts.dive.prepare import DiveOptions, prepare_dive
from hil.common.ports import free_ports

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "how-to"
Scheme = Literal["light", "dark"]
FILES: dict[Scheme, Path] = {"light": FOLDER / "live_view.png", "dark": FOLDER / "live_view_dark.png"}
PICTURES = FOLDER / "live_view_pictures.png"
HARBOUR = """
vehicle = "paper_six"
world = "harbour"
[start]
north = 6
east = -14
depth = 4
[master]
goal = [80, -14]
depth = 4
time_limit = 900
[sensors.camera]
position = [0.25, 0.0, 0.05]
orientation = ["0 deg", "-25 deg", "0 deg"]
rate = 2.0
[sensors.forward_sonar]
device = "oculus_m750d"
position = [0.25, 0.0, 0.0]
orientation = ["0 deg", "-12 deg", "-40 deg"]
max_range = 20.0
rate = 2.0
[sensors.side_scan]
device = "starfish_450"
max_range = 30.0
"""
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"]
WIDTH, HEIGHT = 1280, 800
COLOURS = 256  # of a palette: a third of the size
TIMEOUT_MS = 240_000


def take_pictures(address: str, scheme: Scheme, seconds: float, file: Path) -> Path:
    """Take one picture `seconds` after the scene was drawn; return its file. PICTURES is of the panel of pictures."""
    from PIL import Image
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=OPTIONS)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme=scheme)
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(address)
        frame = page.frame_locator("#scene")
        frame.get_by_text("Pictures").first.wait_for()
        if scheme == "dark":
            frame.get_by_role("checkbox").first.check(force=True)
        if file == PICTURES:
            page.set_viewport_size({"width": WIDTH, "height": HEIGHT + 400})
            frame.get_by_role("tab", name="Pictures").click()
            frame.get_by_text("receive pictures").locator("xpath=following::input[@type='checkbox']").first.check()
        page.wait_for_timeout(1000.0 * seconds)
        notice = frame.locator(".mantine-Notification-closeButton")  # on a browser without a graphics card
        if notice.count():
            notice.first.click(force=True)
            page.wait_for_timeout(2000.0)
        page.screenshot(path=file)
        browser.close()
    with Image.open(file) as picture:
        picture.convert("RGB").quantize(COLOURS).save(file, optimize=True)
    return file


def fly_and_take(scenario: str, speed: float, scheme: Scheme, seconds: float, file: Path) -> Path:
    """Fly the scenario once with a view, and take one picture of it."""
    with tempfile.TemporaryDirectory() as folder:
        if scenario.endswith(".000"):
            scenario = prepare_dive(scenario, DiveOptions(), folder).path
        if file == PICTURES:
            scenario = os.path.join(folder, "harbour.toml")
            Path(scenario).write_text(HARBOUR, encoding="utf-8")
        command = [sys.executable, "-m", "hil.cli", "demo", scenario, "--view", "--output", folder]
        command += ["--set", f"master.speed={speed}", "--listen", f"tcp/127.0.0.1:{free_ports(1)[0]}"]
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as demo:
            assert demo.stdout
            address = re.search(r"http://\S+", demo.stdout.readline())
            assert address, "the demo has no view"
            try:
                return take_pictures(address[0], scheme, seconds, file)
            finally:
                demo.terminate()
                demo.communicate()


def main() -> None:
    """Fly, and take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="?", default="paper_field", metavar="SCENARIO | CHART.000")
    parser.add_argument("--speed", type=float, default=0.15, metavar="M/S", help="of the vehicle [%(default)g]")
    parser.add_argument("--after", type=float, default=60.0, metavar="SECONDS", help="[%(default)g]")
    parser.add_argument("--pictures", action="store_true", help="of camera and sonars, along a pier")
    options = parser.parse_args()
    if options.pictures:
        print(fly_and_take("", options.speed, "light", options.after, PICTURES))
        return
    for scheme, file in FILES.items():
        print(fly_and_take(options.scenario, options.speed, scheme, options.after, file))


if __name__ == "__main__":
    main()
