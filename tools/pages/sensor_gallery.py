"""Describe every sensor, and draw the output of the imaging ones: docs/reference/sensors.md and its pictures.

    python -m tools.pages.sensor_gallery [--out docs/reference] [--only NAME ...]

The texts are docstrings of the sensors, the numbers are their defaults, and the pictures are simulated by each run.
Needs the packages of `pip install -e '.[dev]'`.
"""

import argparse
import inspect
import sys
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

from sim.sensors.sensor_set import load_sensor, select_sensors
from tools.gallery.imaging import ENTRIES
from tools.gallery.places import Entry

ROOT = Path(__file__).parents[2]
STYLE: Any = {"font.size": 8, "axes.titlesize": 8, "legend.fontsize": 7, "savefig.dpi": 110}
COLOURS = 256
HEAD = """\
# What the sensors give

Made by `python -m tools.pages.sensor_gallery`. This page describes the models of the sensors, and shows pictures of the
imaging ones. The pictures are made with default values, unless the text gives others. In plans ahead is up, and
starboard is to the right.

A table `[sensors.NAME]` in the scenario fits a sensor to the vehicle:

- Every sensor has the keys `rate`, `position`, `orientation`, `latency` and `drop_out`.
- Some sensors have `ground_truth`. With `ground_truth = true` they give true values.
- `device` sets the values of a product (`sim/sensors/devices/`).
- Sensors that make pictures run in a separate process.

```toml
[sensors.forward_sonar]
device = "oculus_m750d"
position = [0.2, 0.0, 0.1]
orientation = [0.0, "-10 deg", 0.0]
```

## Water on other pictures

The camera's model of the water also works on pictures from elsewhere, of any renderer or dataset. It needs the distance
of each pixel:

```python
import numpy as np

from sim.environment.optics import Water, jaffe_mcglamery, jerlov, ray_lengths, underwater

rgb = np.full((240, 320, 3), 180, np.uint8)  # sRGB bytes, or linear floats
depth = np.full((240, 320), 4.0)  # m along the optical axis
distance = depth * ray_lengths(320, 240, fx=190.0, fy=190.0, cx=159.5, cy=119.5)
wet = underwater(rgb, distance, jerlov("1C", depth=5.0))
own = underwater(rgb, distance, Water(attenuation=(0.6, 0.3, 0.2), backscatter=(0.5, 0.4, 0.3), veil=(0.05, 0.2, 0.3)))
classic = underwater(rgb, distance, jaffe_mcglamery(attenuation=(0.6, 0.3, 0.2), veil=(0.05, 0.2, 0.3)))
print(wet[120, 160], own[120, 160], classic[120, 160])
```
"""


def save_picture(picture: Any, size: tuple[float, float], path: Path) -> None:
    """Draw one picture and save it as a PNG; `size` in inches."""
    figure = Figure(figsize=size, layout="constrained")
    picture(figure)
    drawn = BytesIO()
    figure.savefig(drawn)
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def page(entries: tuple[Entry, ...], folder: str) -> str:
    """Return the text of docs/reference/sensors.md."""
    lines = [HEAD]
    for entry in entries:
        lines += [f"## {entry.title}", "", f"`[sensors.{entry.sensor}]`", "", *_texts(entry.sensor), ""]
        for picture in entry.pictures:
            name = picture.__name__
            lines += [f"![{name.replace('_', ' ')}]({folder}/{name}.png)", "", _paragraph(picture), ""]
    return "\n".join(lines).rstrip() + "\n"


def _texts(sensor: str) -> list[str]:
    """Return the sensor's description and the source of its numbers, from its docstrings, and a link to its keys."""
    fitted = select_sensors(**{sensor: fit_default(sensor)})[sensor]
    about = (inspect.getdoc(fitted.sensor) or "").split("\n\n")
    source = (inspect.getdoc(type(fitted.model)) or "").split("\n\n")[-1]
    keys = f"Keys and defaults: [`{sensor}`](sensor_keys.md#{sensor})."
    return ["\n\n".join(" ".join(part.split()) for part in [*about, source]), "", keys]


def fit_default(sensor: str) -> Any:
    """Return the record of a sensor's default values."""
    return load_sensor(sensor).Model()


def _paragraph(function: Any) -> str:
    return " ".join((inspect.getdoc(function) or "").split())


def main() -> int:
    """Draw the pictures, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "reference", metavar="FOLDER", help="[%(default)s]")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="NAME", help="draw only these pictures, and do not write the page"
    )
    arguments = parser.parse_args()
    folder = arguments.out / "sensors"
    folder.mkdir(parents=True, exist_ok=True)
    for entry in ENTRIES:
        heights = (entry.size[1], *entry.heights)
        for picture, height in zip(entry.pictures, heights, strict=False):
            if not arguments.only or picture.__name__ in arguments.only:
                print(picture.__name__, flush=True)
                with mpl.rc_context(STYLE):
                    save_picture(picture, (entry.size[0], height), folder / f"{picture.__name__}.png")
    if not arguments.only:
        (arguments.out / "sensors.md").write_text(page(ENTRIES, "sensors"), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
