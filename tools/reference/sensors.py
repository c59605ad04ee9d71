"""Reference page of what the sensors give: their models, from their docstrings, and pictures of the imaging ones."""

import inspect
from pathlib import Path

from hil.common.tables import read_table
from sim.sensors.sensor_set import load_sensor, select_sensors

ENTRIES = read_table(str(Path(__file__).with_suffix(".toml")))  # sensor -> title, and captions by picture
HEAD = """\
# What the sensors give

Made by `python -m tools.reference` from the docstrings of the sensors. Pictures are made with default values, unless
the text gives others. In plans ahead is up, and starboard is to the right.

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


def page() -> str:
    """Return the page of all sensors that have a description."""
    lines = [HEAD]
    for name, entry in ENTRIES.items():
        fitted = select_sensors(**{name: load_sensor(name).Model()})[name]
        about = (inspect.getdoc(fitted.sensor) or "").split("\n\n")
        source = (inspect.getdoc(type(fitted.model)) or "").split("\n\n")[-1]  # of its numbers
        text = "\n\n".join([" ".join(part.split()) for part in (*about, source)])
        keys = f"Keys and defaults: [`{name}`](sensor_keys.md#{name})."
        lines += [f"## {entry['title']}", "", f"`[sensors.{name}]`", "", text, "", keys, ""]
        for picture, caption in entry.get("pictures", {}).items():
            lines += [f"![{picture.replace('_', ' ')}](sensors/{picture}.png)", "", " ".join(caption.split()), ""]
    return "\n".join(lines).rstrip() + "\n"
