"""The mosaic of a camera's pictures: a pixel of a picture lies where its ray meets the bed."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from hil.charts.dive.mosaic import stitch
from hil.charts.grid import Grid
from hil.scenario.config import load_scenario
from sim.rotations import from_euler, rotate
from sim.sensors.imaging.camera.picture import pixel_rays
from sim.sensors.imaging.samples import Intrinsics

ATTITUDE, PLACE, BED = from_euler(0.05, -0.1, 2.3), (3.0, 4.0, 5.0), 8.0
ROW, COLUMN = 190, 80


def test_a_pixel_lies_where_its_ray_meets_the_bed() -> None:
    scenario = load_scenario("paper_field", {"sensors.camera.position": [0.3, 0.1, 0.2],
                                             "sensors.camera.orientation": [0.0, -0.9, 0.1]})  # fmt: skip
    model, mounting = scenario.sensors["camera"].model, scenario.sensors["camera"].mounting
    picture = np.zeros((model.height, model.width, 3), np.uint8)
    picture[ROW - 1 : ROW + 2, COLUMN - 1 : COLUMN + 2] = 255
    truth = SimpleNamespace(time_ns=0, position=PLACE, orientation=ATTITUDE, nu=(0.0,) * 6)
    seen: Any = SimpleNamespace(truth=truth, camera=SimpleNamespace(time_ns=0, data=picture.tobytes()))
    bed = Grid(np.full((41, 41), BED, np.float32), -20.0, -20.0, 1.0)
    mosaic = stitch(scenario, [seen], bed, (-10.0, 15.0, -10.0, 15.0), 0.02)
    found = [-10.0 + 0.02 * (places.mean() + 0.5) for places in np.nonzero(mosaic[..., 0] > 200)]
    focal = 0.5 * model.width / np.tan(0.5 * model.field_of_view)
    centre = 0.5 * (model.width - 1), 0.5 * (model.height - 1)
    rays = pixel_rays(model.width, model.height, Intrinsics(focal, focal, *centre), (0.0,) * 5)
    ray = rays.reshape(model.height, model.width, 3)[ROW, COLUMN]
    toward = rotate(ATTITUDE, rotate(from_euler(*mounting.orientation), ray))
    camera = np.add(PLACE, rotate(ATTITUDE, mounting.position))
    met = camera + np.array(toward) * (BED - camera[2]) / toward[2]
    np.testing.assert_allclose(found, met[:2], atol=0.03)
