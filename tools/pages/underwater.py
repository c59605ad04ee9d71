"""Make the camera's pictures of docs/how-to/imaging.md: `python -m tools.pages.underwater`.

One shows caustics in the shallow end of the installed harbour, the other lamps 0.4 m beside a camera at 160 m depth.
"""

from math import radians
from pathlib import Path

import numpy as np
from PIL import Image

from sim.dynamics import State
from sim.environment.bottom import Bottom
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World, load_world
from sim.rotations import from_euler
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.sensor import Camera
from sim.sensors.mounting import Mounting
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

FOLDER = Path(__file__).parents[2] / "docs" / "how-to"
DEEP = World(
    "deep", "made up", (-40.0, 40.0, -40.0, 40.0), 160.0, bottom=Bottom("mud", ripple_height=0.03),
    cylinder=(Cylinder(3.2, 0.3, 0.15, top=150.0), Cylinder(5.5, -1.2, 0.2, top=150.0)),
    box=(Box(4.0, 1.6, 0.8, 0.8, 0.4, top=159.2),),
)  # fmt: skip
LAMPS = CameraModel(lamps=1.0, lamp_offset=0.4, lamp_shadows=True, backscatter=0.3, snow=300.0)
WIDTH, HEIGHT = 480, 360


def main() -> None:
    """Write both pictures."""
    take_picture("camera_caustics", load_world("harbour"), (8.0, 3.0, 3.2), 0.5, CameraModel(water="IB", caustics=0.9))
    take_picture("camera_lamps", DEEP, (0.0, 0.0, 158.0), 0.0, LAMPS)


def take_picture(name: str, world: World, position: tuple[float, float, float], yaw: float, model: CameraModel) -> None:
    """Write the picture of a camera at a place (m, NED) with a heading of `yaw` rad, tilted down by 18 degrees."""
    scene = Simulation(load_vehicle("bluerov2_heavy")[0], world, {}, position=position)
    down = Mounting(orientation=(0.0, radians(-18.0), 0.0))
    model = model._replace(width=WIDTH, height=HEIGHT)
    sample = Camera(model, down, 1, scene).sample(10**9, State(position, from_euler(0.0, 0.0, yaw)))
    pixels = np.frombuffer(sample.rgb, np.uint8).reshape(sample.height, sample.width, 3)
    Image.fromarray(pixels).save(FOLDER / f"{name}.jpg", quality=85)


if __name__ == "__main__":
    main()
