"""Pictures of sensors that measure distances: laser, scanning sonar, profiler, echosounder, beams of a DVL."""

from math import cos, degrees, isfinite, pi, radians, sin

import numpy as np
from matplotlib.figure import Figure

from sim.environment.obstacles import Box
from sim.environment.world import load_world
from sim.rays.scene import RayScene
from sim.rotations import matrix, rotate
from sim.sensors.extra_samples import LaserSample
from sim.sensors.imaging.scanning_sonar import ScanningSonar, ScanningSonarModel
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.dvl import DvlModel
from sim.sensors.ranging.echosounder import Echosounder, EchosounderModel
from sim.sensors.ranging.laser import Laser, LaserModel
from sim.sensors.ranging.profiler import Profiler, ProfilerModel
from tools.gallery.places import (
    ECHO,
    INK,
    MARK,
    SEED,
    SOFT,
    Entry,
    at,
    harbour,
    make_simulation,
    rough_ground,
    set_axes_ahead_up,
)

PLACE = at(20.0, -8.0, 3.0, heading=30.0)


def _points(sample: LaserSample) -> "np.ndarray[tuple[int, int], np.dtype[np.float64]]":
    """Return the end (m to starboard, m ahead) of each beam with an echo."""
    points = []
    for i, distance in enumerate(sample.ranges):
        angle = sample.angle_min + i * sample.angle_increment
        if isfinite(distance):
            points.append((distance * sin(angle), distance * cos(angle)))
    return np.array(points)


def laser(figure: Figure) -> None:
    """In the world `harbour`, between the two piers, at 3 m depth, bow to 30 deg. Left: the true distances. Right:
    measured with 50 cm of noise, fifty times the default. Dots on lines are the quays, single dots the piles."""
    scene = make_simulation(harbour())
    for place, (title, noise) in enumerate((("ground truth", 0.0), ("with 50 cm of noise", 0.5)), 1):
        axes = figure.add_subplot(1, 2, place)
        model = LaserModel(ground_truth=not noise, max_range=60.0)
        model = model._replace(error=model.error._replace(noise=noise))
        points = _points(Laser(model, Mounting(), SEED, scene).sample(0, PLACE))
        for x, y in points:
            axes.plot((0.0, x), (0.0, y), color=SOFT, linewidth=0.3)
        axes.plot(*points.T, ".", color=INK, markersize=2.5)
        set_axes_ahead_up(axes, 62.0)
        axes.set_title(title)


def scanning_sonar(figure: Figure) -> None:
    """The same place. The ring is the seabed, which the lower edge of the beam (25 deg tall) meets. It is nearer
    where the water is shallower. Within the ring are the piles of the west pier. A turn of 400 pings takes 36 s.
    Left: the vehicle is at rest. Right: it moves ahead at 0.3 m/s, so the ring does not close astern, where the turn
    begins and ends."""
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


def profiler(figure: Figure) -> None:
    """In the world `fractal` with blocks on it, at 18 m depth, bow to the north, with a block 24 m to starboard. One
    ping across the track: dots are measured, the line is the seabed."""
    world = rough_ground()
    state, axes = at(8.0, 0.0, 14.0), figure.add_subplot()
    sample = Profiler(ProfilerModel(), Mounting(), SEED, make_simulation(world)).sample(0, state)
    east = np.linspace(-42.0, 42.0, 800)
    axes.plot(east, [world.seabed(8.0, e) for e in east], color=SOFT, linewidth=1.5, label="seabed")
    points = _points(sample)
    for x, z in points:
        axes.plot((0.0, x), (14.0, 14.0 + z), color=SOFT, linewidth=0.3)
    axes.plot(points[:, 0], 14.0 + points[:, 1], ".", color=INK, markersize=4, label="measured")
    axes.plot(0.0, 14.0, "v", color=MARK, markersize=7, label="vehicle")
    axes.set(xlabel="to starboard, m", ylabel="depth, m", aspect="equal", xlim=(-42, 42), ylim=(37, 11))
    axes.legend(loc="upper left")


def echosounder(figure: Figure) -> None:
    """Over the world `ridge` from south to north, at 3 m depth and 1 m/s. The beam of 25 deg measures the nearest
    point within it. So over the flanks it measures less than the water straight below, and still less over steep
    ones."""
    world = load_world("ridge")
    scene, axes = make_simulation(world), figure.add_subplot()
    norths = np.arange(-75.0, 75.0, 0.1)
    for width, colour, name in ((25.0, INK, "25 deg (Ping2)"), (60.0, MARK, "60 deg")):
        sounder = Echosounder(EchosounderModel(beam_width=radians(width), rings=6), Mounting(), SEED, scene)
        depths = [3.0 + sounder.sample(i, at(n, 0.0, 3.0)).distance for i, n in enumerate(norths)]
        axes.plot(norths, depths, color=colour, linewidth=0.8, label=f"measured, beam of {name}")
    axes.plot(norths, [world.seabed(n, 0.0) for n in norths], color=SOFT, linewidth=2.0, label="seabed below")
    axes.set(xlabel="north, m", ylabel="depth, m", ylim=(27, 8))
    axes.legend(loc="upper right")


def dvl(figure: Figure) -> None:
    """Over the world `slope`, 8 m above it, bow to the north-east, down the slope. Left: the four beams, from astern
    to ahead. Right: where they end, seen from above. The beams ahead reach farther than those astern."""
    world = load_world("slope")
    state, tilt = at(0.0, 0.0, 12.0, heading=45.0), DvlModel().tilt
    angles = [pi / 4.0 + i * pi / 2.0 for i in range(4)]
    beams = [(sin(tilt) * cos(a), sin(tilt) * sin(a), cos(tilt)) for a in angles]
    ranges = RayScene(world).ranges(state.position, np.array(beams).ravel(), 75.0, matrix(state.quaternion))
    side_panel, above = figure.subplots(1, 2)
    aheads = np.linspace(-8.0, 8.0, 50)
    course = rotate(state.quaternion, (1.0, 0.0, 0.0))
    seabed = [world.seabed(a * course[0], a * course[1]) for a in aheads]
    side_panel.plot(aheads, seabed, color=SOFT, linewidth=2.0, label="seabed")
    for angle, (x, y, z), distance in zip(angles, beams, ranges, strict=True):
        ahead, lateral = distance * x, distance * y
        side_panel.plot((0.0, ahead), (12.0, 12.0 + distance * z), color=INK, linewidth=0.8)
        above.plot((0.0, lateral), (0.0, ahead), color=INK, linewidth=0.8)
        above.annotate(f"{degrees(angle):.0f} deg: {distance:.2f} m", (lateral, ahead), ha="center", fontsize=7,
                       xytext=(0, 6 if ahead > 0 else -12), textcoords="offset points")  # fmt: skip
    side_panel.plot(0.0, 12.0, "v", color=MARK, markersize=7)
    side_panel.set(xlabel="ahead, m", ylabel="depth, m", aspect="equal", xlim=(-8, 8), ylim=(22.5, 10.5))
    side_panel.legend(loc="lower left")
    set_axes_ahead_up(above, 5.0)


ENTRIES = (
    Entry("laser", "Scanning laser", (laser,), (8.0, 4.2)),
    Entry("scanning_sonar", "Mechanically scanned sonar", (scanning_sonar, scanning_sonar_echoes), (8.0, 4.2), (6.0,)),
    Entry("profiler", "Multibeam profiler", (profiler,), (8.0, 3.4)),
    Entry("echosounder", "Single-beam echosounder", (echosounder,), (8.0, 3.2)),
    Entry("dvl", "Doppler velocity log", (dvl,), (8.0, 3.6)),
)
