"""Pictures of the imaging sensors: forward-looking, side-scan and scanning sonar, and the camera."""

from math import cos, isfinite, pi, radians, sin
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sim.environment.obstacles import Box
from sim.environment.world import World
from sim.sensors.extra_samples import LaserSample
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.sensor import Camera
from sim.sensors.imaging.forward_sonar import ForwardSonar, ForwardSonarModel
from sim.sensors.imaging.samples import CameraSample, SonarImageSample
from sim.sensors.imaging.scanning_sonar import ScanningSonar, ScanningSonarModel
from sim.sensors.imaging.side_scan import SideScan, SideScanModel
from sim.sensors.mounting import Mounting
from tools.gallery.places import (
    ECHO,
    INK,
    MARK,
    SEED,
    Entry,
    at,
    harbour,
    make_simulation,
    rough_ground,
    set_axes_ahead_up,
)

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
    """A wall ahead, at 24.5 m depth, where daylight is weak and blue. Left: without lamps. Right: with lamps 0.4 m
    beside the camera, which bring back the colours of near objects, with backscatter and particles in the water."""
    world = harbour()._replace(box=(Box(8.0, 0.0, 1.0, 30.0, 0.3, top=22.0),), cylinder=(), depth=26.5, terrain=None)
    scene = make_simulation(world)
    dark = CameraModel(water="IB")
    lit = dark._replace(lamps=8.0, lamp_offset=0.4, backscatter=0.3, snow=300.0)
    for axes, (title, model) in zip(figure.subplots(1, 2), (("daylight", dark), ("lamps", lit)), strict=True):
        eye = Camera(model, Mounting(), SEED, scene)
        _show(axes, _pixels(eye.sample(0, at(4.5, 0.0, 24.5))), title)


def camera_caustics(figure: Figure) -> None:
    """The shallow end of the harbour, 18 deg down, at 3.2 m depth: waves focus the daylight on the seabed."""
    tilted = Mounting(orientation=(0.0, radians(-18.0), 0.0))
    eye = Camera(CameraModel(water="IB", caustics=0.9), tilted, SEED, make_simulation(harbour()))
    _show(figure.subplots(), _pixels(eye.sample(10**9, at(8.0, 3.0, 3.2, heading=28.6))), "caustics 0.9")


PLACE = at(20.0, -8.0, 3.0, heading=30.0)


def _points(sample: LaserSample) -> "np.ndarray[tuple[int, int], np.dtype[np.float64]]":
    """Return the end (m to starboard, m ahead) of each beam with an echo."""
    points = []
    for i, distance in enumerate(sample.ranges):
        angle = sample.angle_min + i * sample.angle_increment
        if isfinite(distance):
            points.append((distance * sin(angle), distance * cos(angle)))
    return np.array(points)


def scanning_sonar(figure: Figure) -> None:
    """In the world `harbour`, between the two piers, at 3 m depth. The ring is the seabed, which the lower edge of the
    beam (25 deg tall) meets. It is nearer where the water is shallower. Within the ring are the piles of the west
    pier. A turn of 400 pings takes 36 s. Left: the vehicle is at rest. Right: it moves ahead at 0.3 m/s, so the ring
    does not close astern, where the turn begins and ends."""
    scene = make_simulation(harbour())
    for place, speed in enumerate((0.0, 0.3), 1):
        axes = figure.add_subplot(1, 2, place)
        sonar = ScanningSonar(ScanningSonarModel(), Mounting(), SEED, scene)
        points = []
        for ping in range(400):
            distance = speed * ping / 11.0
            heading = radians(30.0)
            state = at(20.0 + distance * cos(heading), -8.0 + distance * sin(heading), 3.0, heading=30.0)
            points += _points(sonar.sample(ping, state)).tolist()
        axes.plot(*np.array(points).T, ".", color=INK, markersize=2.5)
        set_axes_ahead_up(axes, 32.0)
        axes.set_title("at rest" if not speed else f"at {speed} m/s")


def scanning_sonar_echoes(figure: Figure) -> None:
    """With `bins`, as the device `ping360`: a turn at rest at the same place, 40 m around, with a block on the
    seabed. The middle is white while the transducer rings. Piles and quays have shadows, and faint arcs of side
    lobes. The seabed begins where the beam first meets it. Oblique surfaces look thicker at a larger distance, because
    the beam is 2 deg wide. Behind the quay there is only noise."""
    world = harbour()
    world = world._replace(box=(*world.box, Box(30.0, -9.0, 3.0, 1.0, 0.5, top=7.2)))
    sonar = ScanningSonar(
        ScanningSonarModel(bins=600, min_range=0.0, max_range=40.0, ringing=0.75),
        Mounting(),
        SEED,
        make_simulation(world),
    )
    pings = [sonar.sample(ping, PLACE).echoes for ping in range(400)]
    grey = np.array([np.frombuffer(echoes.intensities, np.uint8) for echoes in pings]).T
    step = pings[0].range_step
    angles = np.append([echoes.beams[0] for echoes in pings], pi) - 0.5 * step / 40.0
    angle, distance = np.meshgrid(angles, np.arange(601) * step)
    axes = figure.add_subplot()
    places = distance * np.sin(angle), distance * np.cos(angle)
    axes.pcolormesh(*places, grey, cmap=ECHO, rasterized=True)
    set_axes_ahead_up(axes, 41.0)


ENTRIES = (
    Entry("forward_sonar", "Forward-looking sonar", (forward_sonar,), (8.0, 2.5)),
    Entry("side_scan", "Side-scan sonar", (side_scan,), (8.0, 6.0)),
    Entry(
        "camera",
        "Camera and depth camera",
        (camera, camera_waters, camera_lamps, camera_caustics),
        (8.0, 5.6),
        (5.9, 3.2, 3.2),
    ),
    Entry("laser", "Scanning laser"),
    Entry("scanning_sonar", "Mechanically scanned sonar", (scanning_sonar, scanning_sonar_echoes), (8.0, 4.2), (6.0,)),
    Entry("profiler", "Multibeam profiler"),
    Entry("echosounder", "Single-beam echosounder"),
    Entry("dvl", "Doppler velocity log"),
    Entry("imu", "Inertial measurement unit"),
    Entry("pressure", "Pressure"),
    Entry("magnetometer", "Magnetometer"),
    Entry("altimeter", "Altimeter"),
)
