"""Pictures of the imaging sensors: forward-looking and side-scan sonar, and the camera."""

from math import radians
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sim.environment.obstacles import Box
from sim.environment.optics import jerlov, underwater
from sim.environment.world import World
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.sensor import Camera
from sim.sensors.imaging.forward_sonar import ForwardSonar, ForwardSonarModel
from sim.sensors.imaging.samples import CameraSample, SonarImageSample
from sim.sensors.imaging.side_scan import SideScan, SideScanModel
from sim.sensors.mounting import Mounting
from tools.gallery.places import ECHO, MARK, SEED, Entry, at, harbour, make_simulation, rough_ground

TILTED = Mounting((0.2, 0.0, 0.0), (0.0, radians(-10.0), 0.0))
CAMERA = Mounting((0.2, 0.0, 0.0), (0.0, radians(-20.0), 0.0))
BETWEEN_PILES = at(4.0, -21.0, 3.5, heading=10.0)


def _draw_fan(axes: Any, sample: SonarImageSample, grey: Any) -> None:
    """Draw a sonar's picture as a fan, ahead up."""
    beams, spacing = np.array(sample.beams), sample.beams[1] - sample.beams[0]
    edges = np.append(beams - 0.5 * spacing, beams[-1] + 0.5 * spacing)
    ranges = sample.first_range + np.arange(sample.bins + 1) * sample.range_step
    angle, distance = np.meshgrid(edges, ranges)
    axes.pcolormesh(distance * np.sin(angle), distance * np.cos(angle), grey, cmap=ECHO, rasterized=True)
    axes.plot(0.0, 0.0, "^", color=MARK, markersize=7)
    axes.set(aspect="equal", xlabel="to starboard, m", ylabel="ahead, m")


def _intensities(sample: SonarImageSample) -> Any:
    return np.frombuffer(sample.intensities, sample.encoding).reshape(sample.bins, -1)


def _add_blocks(world: World) -> World:
    """Return the world with two blocks on the harbour's seabed."""
    return world._replace(
        box=(*world.box, Box(20.0, -10.0, 3.0, 1.0, 0.5, top=6.7), Box(14.0, -14.0, 0.8, 0.8, 0.2, top=6.3))
    )


def forward_sonar(figure: Figure) -> None:
    """In the world `harbour` with two blocks, between the piles of the west pier, at 3.5 m depth. The sonar is
    tilted down by 10 deg. Left: the measured picture. It has bright piles, each with its shadow on the seabed and
    the arc of its side lobes, a quay to port, speckle, and the texture of the seabed. It is dark before the beam
    first meets the seabed. Right: the ground truth, as mean echoes in dB re the source, at 1 m. With `multipath =
    true` there are also echoes reflected by surface and seabed, behind strong echoes."""
    scene = make_simulation(_add_blocks(harbour()))
    measured, true = figure.subplots(1, 2)
    sample = ForwardSonar(ForwardSonarModel(), TILTED, SEED, scene).sample(0, BETWEEN_PILES)
    _draw_fan(measured, sample, _intensities(sample))
    measured.set_title("as measured")
    sample = ForwardSonar(ForwardSonarModel(ground_truth=True, multipath=True), TILTED, SEED, scene).sample(
        0, BETWEEN_PILES
    )
    with np.errstate(divide="ignore"):
        _draw_fan(true, sample, np.maximum(10.0 * np.log10(_intensities(sample)), -150.0))
    figure.colorbar(true.collections[0], ax=true, label="dB", shrink=0.7)
    true.set_title("ground truth")


def forward_sonar_rows(figure: Figure) -> None:
    """The same picture as in the message: a row is a range bin, a column is a beam, port is left."""
    axes = figure.add_subplot()
    sample = ForwardSonar(ForwardSonarModel(), TILTED, SEED, make_simulation(harbour())).sample(0, BETWEEN_PILES)
    first, last = (np.degrees(sample.beams[i]) for i in (0, -1))
    far = sample.first_range + sample.bins * sample.range_step
    axes.imshow(
        _intensities(sample), ECHO, aspect="auto", origin="lower", extent=(first, last, sample.first_range, far)
    )
    axes.set(xlabel="beam, deg to starboard", ylabel="range, m")


def side_scan(figure: Figure) -> None:
    """In the world `fractal` with a wall, a block and a bollard on it, at 18 m depth, 80 m to the north at 1 m/s. A
    line is a ping, the oldest below. The line in the middle is the ringing of the transducers, then comes the water
    below the vehicle, then the first return of the bottom. Behind each object lies its shadow, which is longer at a
    larger distance. The ground is rock. Its relief below the cells of the grid (2 m), and its kind at each place, are
    generated."""
    scene, axes = make_simulation(rough_ground()), figure.add_subplot()
    scan = SideScan(SideScanModel(max_range=50.0), Mounting(), SEED, scene)
    lines = []
    for ping in range(400):
        sample = scan.sample(ping, at(-40.0 + 0.2 * ping, 0.0, 18.0))
        port, starboard = (np.frombuffer(side, np.uint8) for side in (sample.port, sample.starboard))
        lines.append(np.concatenate([port[::-1], starboard]))
    axes.imshow(np.array(lines), ECHO, aspect="equal", origin="lower", extent=(-50.0, 50.0, -40.0, 40.0))
    axes.set(xlabel="slant range, m (port to the left, starboard to the right)", ylabel="north, m")


def _take_picture(model: CameraModel, mounting: Mounting = CAMERA) -> CameraSample:
    return Camera(model, mounting, SEED, make_simulation(harbour())).sample(0, BETWEEN_PILES)


def _pixels(sample: CameraSample) -> Any:
    return np.frombuffer(sample.rgb, np.uint8).reshape(sample.height, sample.width, 3)


def _show(axes: Any, picture: Any, title: str, **how: Any) -> Any:
    shown = axes.imshow(picture, **how)
    axes.set_title(title)
    axes.set(xticks=[], yticks=[])
    return shown


def camera(figure: Figure) -> None:
    """The same place as for the forward-looking sonar, 20 deg down. Left: colours and depth as measured in oceanic
    water of type IB. Right: the ground truth, without water, and the object to which each pixel belongs."""
    measured, true = _take_picture(CameraModel(water="IB")), _take_picture(CameraModel(ground_truth=True))
    (colour, dry), (depth, labels) = figure.subplots(2, 2)
    _show(colour, _pixels(measured), "colours, water IB")
    _show(dry, _pixels(true), "colours, ground truth")
    assert measured.depth is not None
    assert true.labels is not None
    shape = measured.height, measured.width
    metres = np.frombuffer(measured.depth, np.float32).reshape(shape)
    shown = _show(depth, np.where(np.isfinite(metres), metres, np.nan), "depth along the axis", cmap="viridis_r")
    figure.colorbar(shown, ax=depth, label="m", shrink=0.8)
    numbers = np.unique(np.frombuffer(true.labels, np.int32), return_inverse=True)[1].reshape(shape)
    _show(labels, numbers, "labels", cmap="tab20", interpolation="nearest")


def camera_waters(figure: Figure) -> None:
    """The same view in four waters, from the clearest ocean to a turbid coast, with automatic exposure. Red
    disappears first. Distant objects take the colour of the water."""
    for axes, water in zip(figure.subplots(2, 2).ravel(), ("I", "IB", "II", "1C"), strict=True):
        _show(axes, _pixels(_take_picture(CameraModel(water=water))), f"Jerlov {water}")  # type: ignore[arg-type]


def camera_lamps(figure: Figure) -> None:
    """A wall ahead, at 24.5 m depth, where daylight is weak and blue. Left: without lamps. Right: with lamps, which
    bring back the colours of near objects."""
    world = harbour()._replace(box=(Box(8.0, 0.0, 1.0, 30.0, 0.3, top=22.0),), cylinder=(), depth=26.5, terrain=None)
    scene = make_simulation(world)
    for axes, (title, lamps) in zip(figure.subplots(1, 2), (("daylight", 0.0), ("lamps", 8.0)), strict=True):
        eye = Camera(CameraModel(water="IB", lamps=lamps), Mounting(), SEED, scene)
        _show(axes, _pixels(eye.sample(0, at(4.5, 0.0, 24.5))), title)


def others_pictures(figure: Figure) -> None:
    """`sim.environment.optics.underwater` on a picture with depths from elsewhere. Left: a test chart at 2, 4, 8 and
    16 m. Then: the same through three waters, at 5 m depth."""
    patches = np.array([[230, 230, 230], [200, 40, 40], [40, 170, 60], [50, 70, 200], [220, 190, 40]], np.uint8)
    chart = np.repeat(np.repeat(np.tile(patches, (4, 1, 1)), 24, axis=0), 24, axis=1)
    depth = np.repeat([2.0, 4.0, 8.0, 16.0], 24)[:, None] * np.ones((1, 120))
    panels = figure.subplots(1, 4)
    _show(panels[0], chart, "in air")
    for axes, water in zip(panels[1:], ("I", "IB", "1C"), strict=True):
        _show(axes, underwater(chart, depth, jerlov(water, depth=5.0)), f"Jerlov {water}")
    panels[0].set(yticks=[12, 36, 60, 84], yticklabels=["2 m", "4 m", "8 m", "16 m"])


ENTRIES = (
    Entry("forward_sonar", "Forward-looking sonar", (forward_sonar, forward_sonar_rows), (8.0, 2.5), (3.2,)),
    Entry("side_scan", "Side-scan sonar", (side_scan,), (8.0, 6.0)),
    Entry(
        "camera",
        "Camera and depth camera",
        (camera, camera_waters, camera_lamps, others_pictures),
        (8.0, 5.6),
        (5.9, 3.2, 1.9),
    ),
)
