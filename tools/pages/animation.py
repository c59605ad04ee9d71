"""Draw the animation of the README: one dive over the seabed of a chart, as the vehicle's sensors measure it.

    python -m tools.pages.animation CHART.000 [--start LAT,LON --goal LAT,LON --depth M] [--output docs/dive.gif]

A slave and a master fly the dive in real time as `uuv-hil demo --world` does, which takes two minutes. Every frame
shows the map with the true track so far, and the pictures of camera and forward-looking sonar that were last received
over the network. Needs the packages of `pip install -e '.[dev]'`, and a chart such as NOAA's US5AK5SI. There, --start
59.603657,-151.420325 --goal 59.603284,-151.4199 --depth 3.2 leads between floats, near enough to the seabed for the
camera.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from hil.charts.dive.prepare import DiveOptions, prepare_dive
from hil.charts.dive.report import MARK, draw_camera, draw_seabed, draw_sonar
from hil.charts.dive.watch import DiveWatch, Observation
from hil.common.children import module_command, package_environment, start_child
from hil.common.errors import MissionError
from hil.common.options import lat_lon
from hil.common.palette import TRACK
from hil.plots.plotting import pyplot
from hil.scenario.config import Scenario, load_scenario
from sim.environment.world import World, load_world

ROOT = Path(__file__).parents[2]
OUTPUT = ROOT / "docs" / "dive.gif"
FRAMES = 48
FRAME_MS = 140
SIZE = (9.6, 2.7)  # inches
DPI = 84
COLOURS = 96
MAX_BYTES = 3_000_000


def fly(chart: str, options: DiveOptions, folder: str) -> tuple[Scenario, list[Observation]]:
    """Fly one dive over `chart`; return the scenario, and one observation per second. Raises HilError."""
    path = prepare_dive(chart, options, folder).path
    scenario = load_scenario(path)
    with DiveWatch(scenario) as watch:
        demo = start_child(
            module_command("hil.cli", "demo", path, "--output", folder), environment=package_environment()
        )
        while demo.poll() is None:
            watch.observe()
    if demo.returncode or not watch.observations:
        raise MissionError(f"the dive ended with exit code {demo.returncode}; see {folder}/slave.log")
    return scenario, watch.observations


def draw_frame(plt: Any, world: World, observations: Sequence[Observation], number: int) -> Image.Image:
    """Return the picture of one instant: map, camera, sonar."""
    observation, track = observations[number], np.array([each.truth.position[:2] for each in observations])
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=SIZE, layout="constrained", width_ratios=(1.0, 1.2, 1.6))
    draw_seabed(left, world, track)
    left.plot(track[: number + 1, 1], track[: number + 1, 0], color=TRACK, linewidth=2)
    left.plot(*track[number, ::-1], "o", color=MARK, markeredgecolor="black", markersize=7)
    left.set(xticks=[], yticks=[])
    left.set_title("chart, and the true track", fontsize=9)
    draw_camera(middle, observation.camera)
    middle.set_title("camera", fontsize=9)
    draw_sonar(right, observation.sonar)
    right.set(xlabel="", ylabel="")
    right.tick_params(labelsize=7)
    right.set_title(f"forward-looking sonar (m), {observation.time:3.0f} s", fontsize=9)
    drawn = BytesIO()
    figure.savefig(drawn, dpi=DPI)
    plt.close(figure)
    return Image.open(drawn).convert("RGB")


def save_gif(frames: Sequence[Image.Image], path: Path) -> None:
    """Write the frames as a GIF that repeats, in one palette. Raises ValueError if the file is too large."""
    shown = [frames[index] for index in (0, len(frames) // 3, 2 * len(frames) // 3, -1)]
    sheet = Image.new("RGB", (shown[0].width, len(shown) * shown[0].height))
    for row, picture in enumerate(shown):
        sheet.paste(picture, (0, row * picture.height))
    palette = sheet.quantize(COLOURS)
    first, *rest = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in frames]
    first.save(path, save_all=True, append_images=rest, duration=FRAME_MS, loop=0, optimize=True)
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path} has {path.stat().st_size} bytes, more than {MAX_BYTES}: make SIZE or FRAMES smaller")


def main() -> int:
    """Fly the dive, draw the frames, and write the animation."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("chart", metavar="CHART.000")
    parser.add_argument(
        "--start", type=lat_lon, metavar="LAT,LON", help="degrees, with --goal [selected as by `demo --world`]"
    )
    parser.add_argument("--goal", type=lat_lon, metavar="LAT,LON")
    parser.add_argument("--depth", type=float, metavar="M")
    parser.add_argument("--output", type=Path, default=OUTPUT, metavar="FILE", help="[%(default)s]")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scenario, observations = fly(options.chart, DiveOptions(options.start, options.goal, options.depth), folder)
        world, plt = load_world(scenario.world), pyplot()
        chosen = np.linspace(0, len(observations) - 1, min(FRAMES, len(observations)), dtype=int)
        save_gif([draw_frame(plt, world, observations, int(number)) for number in chosen], options.output)
    print(options.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
