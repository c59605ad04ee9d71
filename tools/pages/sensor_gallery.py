"""Draw what every sensor gives: docs/reference/sensors.md and its pictures.

    python -m tools.pages.sensor_gallery [--out docs/reference] [--only NAME ...]

The texts are those of the sensors' own source, the numbers their defaults, the pictures simulated again. Needs what
`pip install -e '.[dev]'` brings.
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

from sim.sensors.suite import SENSORS, fit
from tools.gallery import imaging, moving, ranging
from tools.gallery.places import Entry

ROOT = Path(__file__).parents[2]
ENTRIES: tuple[Entry, ...] = (*imaging.ENTRIES, *ranging.ENTRIES, *moving.ENTRIES)
STYLE: Any = {"font.size": 8, "axes.titlesize": 8, "legend.fontsize": 7, "savefig.dpi": 110}
COLOURS = 256
HEAD = """\
# What the sensors give

Made by `python -m tools.pages.sensor_gallery`: each picture is what the simulator's sensor gives at that place, with
its default values but for those that are named. In pictures up is up; in plans ahead is up and starboard to the right.

Every sensor is switched on by its section in a scenario, and takes `rate`, `position` and `orientation` in the vehicle,
`latency` and `drop_out` beside the keys that are listed; with `ground_truth = true`, where it is listed, it says what
is true. Those that make images run in a process of their own. A `device` gives the values of one that can be bought
(`sim/sensors/devices/`):

```toml
[sensors.forward_sonar]
device = "oculus_m750d"
position = [0.2, 0.0, 0.1]
orientation = [0.0, "-10 deg", 0.0]
```

## Water on other pictures

What the camera's water does can be had for any picture with depths, from whichever renderer or dataset:

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


def draw(picture: Any, size: tuple[float, float], path: Path) -> None:
    """Save one picture."""
    figure = Figure(figsize=size, layout="constrained")
    picture(figure)
    drawn = BytesIO()
    figure.savefig(drawn)
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def page(entries: tuple[Entry, ...], folder: str) -> str:
    """Return the whole of docs/reference/sensors.md."""
    lines = [HEAD]
    for entry in entries:
        lines += [f"## {entry.title}", "", f"`[sensors.{entry.sensor}]`", "", *_texts(entry.sensor), ""]
        for picture in entry.pictures:
            name = picture.__name__
            lines += [f"![{name.replace('_', ' ')}]({folder}/{name}.png)", "", _paragraph(picture), ""]
    return "\n".join(lines).rstrip() + "\n"


def _texts(sensor: str) -> list[str]:
    """Return what the sensor is, its keys, and what it says of them, out of its source."""
    fitted = fit(**{sensor: fit_default(sensor)})[sensor]
    keys = ", ".join(f"`{key} = {_toml(value)}`" for key, value in fitted.model._asdict().items())
    model = inspect.getdoc(type(fitted.model)) or ""
    about = inspect.getdoc(fitted.sensor) or ""
    return [about.replace("\n\n", "\0").replace("\n", " ").replace("\0", "\n\n"), "", f"Keys: {keys}.", "",
            model.replace("\n\n", "\0").replace("\n", " ").replace("\0", "\n\n")]  # fmt: skip


def fit_default(sensor: str) -> Any:
    """Return the record of a sensor's default values."""
    from importlib import import_module

    module, _, name = SENSORS[sensor].partition(":")
    return getattr(import_module(module), name).Model()


def _toml(value: Any) -> str:
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        usual: Any = type(value)
        changed = {k: v for k, v in value._asdict().items() if v != usual._field_defaults.get(k)}
        return "{" + ", ".join(f"{k} = {_toml(v)}" for k, v in changed.items()) + "}"
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else f"{value:.6g}"


def _paragraph(function: Any) -> str:
    return " ".join((inspect.getdoc(function) or "").split())


def main() -> int:
    """Draw, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "reference", metavar="FOLDER", help="[%(default)s]")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these pictures alone, and no page")
    arguments = parser.parse_args()
    folder = arguments.out / "sensors"
    folder.mkdir(parents=True, exist_ok=True)
    for entry in ENTRIES:
        heights = (entry.size[1], *entry.heights)
        for picture, height in zip(entry.pictures, heights, strict=True):
            if not arguments.only or picture.__name__ in arguments.only:
                print(picture.__name__, flush=True)
                with mpl.rc_context(STYLE):
                    draw(picture, (entry.size[0], height), folder / f"{picture.__name__}.png")
    if not arguments.only:
        (arguments.out / "sensors.md").write_text(page(ENTRIES, "sensors"), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
