"""Log state, thrusts and every force of a simulated vehicle, as a table and a picture."""

from collections.abc import Callable
from itertools import accumulate, pairwise
from math import degrees
from typing import Any

from hil.common.clock import NS_PER_S
from hil.common.tables import csv_text, save_text
from hil.plots.plotting import add_legend, curve, pyplot, save_figure
from sim.dynamics import Forces
from sim.rotations import to_euler
from sim.simulation import Simulation

PERIOD_NS = NS_PER_S // 20
POSE = ("time_s", "north_m", "east_m", "down_m", "roll_rad", "pitch_rad", "yaw_rad")
SPEEDS = ("u_m_s", "v_m_s", "w_m_s", "p_rad_s", "q_rad_s", "r_rad_s")
AXES = ("x_n", "y_n", "z_n", "k_nm", "m_nm", "n_nm")
PANELS = (
    ("track", "depth"), ("track", "heading"), ("track", "attitude"), ("speed", "thrust"), ("surge", "heave"),
    ("pitch", "yaw"),
)  # fmt: skip
TOTAL = {"color": "black", "linestyle": "-"}
DrawTrack = Callable[[Any, list[float], list[float]], None]  # axes, m east, m north


class Flight:
    """Record of a simulation: 20 rows per second of simulation time, and one at the first step of each contact."""

    def __init__(self, simulation: Simulation) -> None:
        self.columns = [
            *POSE,
            *SPEEDS,
            *(f"thrust_{thruster.name}_n" for thruster in simulation.vehicle.thrusters),
            *(f"{term}_{axis}" for term in Forces._fields for axis in AXES),
        ]
        self.rows: list[list[float]] = []
        self.title = f"{simulation.vehicle.name} in {simulation.world.name}"
        self._due_ns = 0
        self._touched_ns = -PERIOD_NS
        self._contacts: list[int] = []  # numbers of the rows in which a contact begins

    def record(self, simulation: Simulation) -> None:
        """Record the present state if the period has passed, or at a new contact."""
        now, hits = simulation.time_ns, False
        if simulation.touching:
            hits, self._touched_ns = now - self._touched_ns > PERIOD_NS, now
        if now < self._due_ns and not hits:
            return
        if now >= self._due_ns:
            self._due_ns += PERIOD_NS
        if hits:
            self._contacts.append(len(self.rows))
        state = simulation.state
        attitude = to_euler(state.quaternion)
        pose = [simulation.time_ns / NS_PER_S, *state.position, *attitude, *state.nu]
        forces = [x for term in simulation.forces() for x in term]
        self.rows.append([*pose, *simulation.thrusts, *forces])

    def write(self, path: str) -> None:
        """Write the table as CSV, with names and units in the first line. Raises ConfigError."""
        save_text(path, csv_text([self.columns, *([f"{x:.9g}" for x in row] for row in self.rows)]))

    def draw(self, path: str, draw_track: DrawTrack) -> None:
        """Draw track, depth, attitude, speeds, thrusts, and the forces of each kind; `draw_track` draws the first.

        Raises ConfigError, MissingExtraError.
        """
        plt = pyplot()
        figure, axes = plt.subplot_mosaic(PANELS, figsize=(16, 17), width_ratios=(5, 4), layout="constrained")
        axes["track"].set_title("track from above")
        draw_track(axes["track"], self._column("east_m"), self._column("north_m"))
        self._lines(axes["depth"], {"depth": "down_m"}, "depth (m)", "depth of the vehicle's origin")
        axes["depth"].invert_yaxis()
        self._lines(axes["heading"], {"heading": "yaw_rad"}, "heading (°)", "heading, 0 to the north, 90 to the east")
        attitude = {"roll, to starboard": "roll_rad", "pitch, bow up": "pitch_rad"}
        self._lines(axes["attitude"], attitude, "angle (°)", "roll and pitch")
        speeds = {"surge u": "u_m_s", "sway v": "v_m_s", "heave w": "w_m_s"}
        self._lines(axes["speed"], speeds, "velocity (m/s)", "velocity over ground, body axes")
        thrusts = {name[7:-2].replace("_", " "): name for name in self.columns if name.startswith("thrust_")}
        self._lines(axes["thrust"], thrusts, "thrust (N)", "thrust of each motor")
        for name, axis, quantity, title in (
            ("surge", "x_n", "force (N)", "surge forces, along body x (forward)"),
            ("heave", "z_n", "force (N)", "heave forces, along body z (down)"),
            ("pitch", "m_nm", "moment (N m)", "pitch moments, about body y (starboard)"),
            ("yaw", "n_nm", "moment (N m)", "yaw moments, about body z (down)"),
        ):
            curves = {term.replace("_", " "): f"{term}_{axis}" for term in Forces._fields}
            self._lines(axes[name], curves, quantity, title)
            self._leave_out_contacts(axes[name], f"contact_{axis}")
        figure.suptitle(self.title)
        save_figure(figure, path)

    def _leave_out_contacts(self, axes: Any, contact: str) -> None:
        """Scale the axis without the contact forces, which are about a hundred times larger and shown as numbers."""
        if not self._contacts or not axes.lines:
            return
        calm = [y for line in axes.lines for row, y in enumerate(line.get_ydata()) if row not in self._contacts]
        low, high = min(calm, default=0.0), max(calm, default=0.0)
        slack = 0.05 * (high - low) or 1.0
        axes.set_ylim(low - slack, high + slack)
        times, forces = self._column("time_s"), self._column(contact)
        for row in self._contacts:
            if not low - slack <= forces[row] <= high + slack:
                edge = low if forces[row] < 0.0 else high
                axes.annotate(f" contact {forces[row]:.0f}", (times[row], edge), fontsize="x-small", rotation=90,
                              va="bottom" if edge == low else "top")  # fmt: skip

    def _lines(self, axes: Any, curves: dict[str, str], quantity: str, title: str) -> None:
        time = self._column("time_s")
        for number, (label, name) in enumerate(curves.items()):
            values = self._column(name)
            if name in POSE[4:]:
                values = _degrees(values)
            if any(values):  # no line for a force that is always zero
                axes.plot(
                    time, values, **{**curve(number), **TOTAL} if label == "total" else curve(number), label=label
                )
        axes.set(xlabel="time (s)", ylabel=quantity, title=title)
        if len(curves) > 1:
            add_legend(axes)

    def _column(self, name: str) -> list[float]:
        place = self.columns.index(name)
        return [row[place] for row in self.rows]


def _degrees(values: list[float]) -> list[float]:
    """Return angles in degrees, without jumps where one passes 180 or -180."""
    angles = [degrees(value) for value in values]
    turns = accumulate(round((a - b) / 360.0) for a, b in pairwise(angles))
    return [angle + 360.0 * turn for angle, turn in zip(angles, (0, *turns), strict=True)]
