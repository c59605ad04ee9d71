"""Side-scan sonar against planes and blocks; devices; and images of all sensors with either engine."""

from math import isinf, pi, radians, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.common.errors import ConfigError, MissingExtraError
from sim.dynamics import State
from sim.environment.obstacles import Box, Cylinder
from sim.environment.relief import Fractal
from sim.environment.terrain import Terrain, covering
from sim.rays.scene import Engine, RayScene
from sim.rotations import from_euler
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.sensor import Camera
from sim.sensors.imaging.echoes import first_null
from sim.sensors.imaging.forward_sonar import ForwardSonar, ForwardSonarModel
from sim.sensors.imaging.range_image import RangeImager
from sim.sensors.imaging.samples import SideScanSample
from sim.sensors.imaging.scanning_sonar import ScanningSonar, ScanningSonarModel
from sim.sensors.imaging.side_scan import SideScan, SideScanModel
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import read_sensors
from tests.support.fitted import EXTENT, FLAT, scene
from tests.support.flights.twins import taken_from

AHEAD = State((0.0, 0.0, 10.0))


def one_side(sample: SideScanSample, side: str) -> Any:
    return np.frombuffer(getattr(sample, side), sample.encoding)


SCAN = SideScanModel(ground_truth=True, max_range=60.0, rays=3000, surface_strength=-200.0)


def test_the_first_bottom_return_is_at_the_altitude() -> None:
    scan = SideScan(SCAN, Mounting(), 1, scene())
    sample = scan.sample(0, AHEAD)
    assert sample.altitude == pytest.approx(10.0, abs=1e-4)
    for which in ("port", "starboard"):
        column = one_side(sample, which)
        assert len(column) == sample.bins == 600
        assert not column[:99].any()
        assert column[101:].all()
    assert one_side(sample, "port") == pytest.approx(one_side(sample, "starboard"), rel=1e-6)


def test_a_block_to_starboard_has_its_shadow() -> None:
    """A block from 18 to 22 m aside and 4 m high, 10 m above the seabed: its top's far edge shades to 22 * 10 / 6 m."""
    world = FLAT._replace(box=(Box(0.0, 20.0, 6.0, 4.0, top=16.0),))
    sample = SideScan(SCAN, Mounting(), 1, scene(world)).sample(0, AHEAD)
    starboard, port = one_side(sample, "starboard"), one_side(sample, "port")
    front = sqrt(18.0**2 + 6.0**2), sqrt(18.0**2 + 10.0**2)  # the face, from its upper edge on
    shade = sqrt(22.0**2 + 6.0**2), sqrt((22.0 / 0.6) ** 2 + 10.0**2)
    face = slice(int(front[0] / 0.1) + 1, int(front[1] / 0.1) - 1)
    assert starboard[face].min() > 3.0 * port[face].max()
    dark = starboard[int(shade[0] / 0.1) + 2 : int(shade[1] / 0.1) - 2]
    assert len(dark) > 100
    assert dark.max() < 1e-9 * port.max()
    assert starboard[int(shade[1] / 0.1) + 6] > 0.0
    assert (port[101:] > 0.0).all()


def test_rays_of_a_side_scan_are_denser_at_grazing_incidence() -> None:
    """From the top of the lobe, 6 deg above the level, to nadir; a ray is as tall as the sine of its angle and 0.15."""
    model = SCAN._replace(rays=40, beam_height=radians(30.0), depression=radians(10.0))
    edges = SideScan(model, Mounting(), 1, scene())._pinger._aperture.edges[0]
    downs = np.arctan2(edges[:, 2], -edges[:, 1])
    assert downs[[0, -1]] == pytest.approx([radians(10.0) - first_null(radians(30.0)), 0.5 * pi])
    heights = np.diff(downs) / (np.abs(np.sin(0.5 * (downs[1:] + downs[:-1]))) + 0.15)
    assert heights == pytest.approx(np.full(40, heights.mean()), rel=0.04)


def test_sensors_of_pictures_need_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    kinds: list[Any] = [Camera, SideScan, ForwardSonar, RangeImager, ScanningSonar]
    for kind in kinds:
        with pytest.raises(MissingExtraError, match=f"{kind.topic} needs numpy"):
            kind(ScanningSonarModel(bins=9) if kind is ScanningSonar else kind.Model(), Mounting(), 1, scene())


def test_a_side_scan_receives_nothing_out_of_the_water() -> None:
    ping = SideScan(SideScanModel(ground_truth=True), Mounting(), 1, scene()).sample(0, State((0.0, 0.0, -0.5)))
    assert isinf(ping.altitude)
    assert not one_side(ping, "port").any()


def test_a_side_scan_turns_with_the_vehicle() -> None:
    """The block to the east is to port of a vehicle heading south."""
    world = FLAT._replace(box=(Box(0.0, 20.0, 6.0, 4.0, top=16.0),))
    scan = SideScan(SCAN, Mounting(), 1, scene(world))
    north, south = (scan.sample(0, State((0.0, 0.0, 10.0), from_euler(0.0, 0.0, yaw))) for yaw in (0.0, pi))
    assert one_side(north, "starboard") == pytest.approx(one_side(south, "port"), rel=1e-3, abs=1e-15)
    assert one_side(north, "port") != pytest.approx(one_side(south, "port"), rel=0.1, abs=1e-15)


@pytest.mark.parametrize("device", ["oculus_m750d", "oculus_m750d_high", "gemini_720is", "blueview_p900_130"])
def test_every_sonar_device_gives_samples(device: str) -> None:
    sensors = read_sensors({"forward_sonar": {"device": device, "rays": 4, "max_range": 30.0, "rate": 2.0}}, "test")
    fitted = sensors["forward_sonar"]
    assert fitted.model.max_range == 30.0
    sample = ForwardSonar(fitted.model, fitted.mounting, 1, scene()).sample(0, AHEAD)
    assert len(sample.beams) * sample.bins == len(sample.intensities)
    assert sample.frequency >= 720e3


def test_a_device_of_another_sensor_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"side_scan: device: .*gemini_720is\.toml is no side_scan"):
        read_sensors({"side_scan": {"device": "gemini_720is"}}, "test")
    with pytest.raises(ConfigError, match="starfish_450"):
        read_sensors({"side_scan": {"device": "starfish"}}, "test")
    assert read_sensors({"side_scan": {"device": "starfish_450"}}, "test")["side_scan"].model.beam_width == radians(0.8)


def test_rays_in_numpy_and_c_give_the_same_pictures(binaries: Path) -> None:
    """Pictures by numpy's rays equal those by C to the last byte: sonars and camera, rough ground with obstacles."""
    grid = covering(EXTENT, 1.0)
    terrain = Terrain(grid, Fractal(15.0, 1.5, seed=4).depths(grid), 20.0)
    world = FLAT._replace(terrain=terrain, cylinder=(Cylinder(15.0, 5.0, 1.0),), box=(Box(8.0, -4.0, 2.0, 2.0, 0.4),))
    makers: list[Any] = [
        lambda: ForwardSonar(ForwardSonarModel(beams=128, rays=16), Mounting(), 1, scene(world)),
        lambda: SideScan(SideScanModel(rays=200), Mounting(), 1, scene(world)),
        lambda: Camera(CameraModel(width=64, height=48), Mounting(), 1, scene(world)),
    ]

    def samples(engine: Engine) -> list[Any]:
        with pytest.MonkeyPatch.context() as patch, taken_from(binaries):
            patch.setattr(RayScene.__init__, "__defaults__", (engine,))
            return [make().sample(0, State((0.0, 0.0, 8.0), from_euler(0.1, -0.2, 0.3))) for make in makers]

    assert samples("C") == samples("python")


def test_the_surface_echoes_to_a_side_scan_below() -> None:
    """The lobe 8 m below the surface, 12 m above the seabed, reaches up to 60 deg; the altitude is over the seabed."""
    state = State((0.0, 0.0, 8.0))
    model = SCAN._replace(beam_height=radians(170.0), surface_strength=-30.0)
    wide = SideScan(model, Mounting(), 1, scene()).sample(0, state)
    no_surface = SideScan(model._replace(surface_strength=-200.0), Mounting(), 1, scene()).sample(0, state)
    port, dry = one_side(wide, "port"), one_side(no_surface, "port")
    first = int(port.nonzero()[0][0])
    assert first == pytest.approx(80.0 / sin(radians(60.0)), abs=1)
    assert (port[first:119] > 0.0).all()
    assert not dry[:119].any()
    assert wide.altitude == no_surface.altitude == pytest.approx(12.0, abs=0.01)


def test_the_far_edge_of_an_oblique_walls_shadow_is_a_line() -> None:
    """A wall 2 m high, askew to the track, 10 m below the sonar and about 28 m away; by geometry, in bins of 0.1 m."""
    height, altitude, askew = 2.0, 10.0, 0.2
    wall = Box(0.0, 30.0, 60.0, 0.2, askew, top=20.0 - height)
    model = SideScanModel(ground_truth=True, surface_strength=-200.0)
    sonar = SideScan(model, Mounting(), 1, scene(FLAT._replace(extent=(-200.0, 200.0, -200.0, 200.0), box=(wall,))))
    middles = (np.arange(1000) + 0.5) * model.range_step
    errors = []
    for north in np.arange(-10.0, 10.0, 0.1):
        echoes = one_side(sonar.sample(0, State((north, 0.0, 20.0 - altitude))), "starboard")
        away = 30.0 + north * np.tan(askew) + 0.1 / np.cos(askew)
        edge = np.hypot(away * altitude / (altitude - height), altitude)
        lit = echoes > 0.2 * np.median(echoes[(middles > edge + 3.0) & (middles < edge + 8.0)])
        within = (middles > edge - 3.0) & (middles < edge + 3.0)
        errors.append(middles[lit & within][0] - 0.5 * model.range_step - edge)
    assert np.mean(errors) == pytest.approx(0.0, abs=0.1)
    assert np.std(errors) < 0.1, "rays at equal angles make it 0.114"
