"""The flight recorder of a simulation: state, thrusts and every force on the vehicle, as a table and a picture."""

import csv
from typing import Any

from hil.bench.plotting import pyplot
from hil.clock import NS_PER_S
from hil.errors import ConfigError
from sim.dynamics import Forces
from sim.rotations import to_euler
from sim.simulation import Simulation

PERIOD_NS = NS_PER_S // 20
POSE = ("time_s", "north_m", "east_m", "down_m", "roll_rad", "pitch_rad", "yaw_rad")
SPEEDS = ("u_m_s", "v_m_s", "w_m_s", "p_rad_s", "q_rad_s", "r_rad_s")
AXES = ("x_n", "y_n", "z_n", "k_nm", "m_nm", "n_nm")


class Flight:
    """Notes a simulation as it goes, 20 times a second of its time."""

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

    def note(self, simulation: Simulation) -> None:
        """Take down what there is now, if it is time."""
        if simulation.time_ns < self._due_ns:
            return
        self._due_ns += PERIOD_NS
        state = simulation.state
        attitude = to_euler(state.quaternion)
        pose = [simulation.time_ns / NS_PER_S, *state.position, *attitude, *state.nu]
        forces = [x for term in simulation.forces() for x in term]
        self.rows.append([*pose, *simulation.thrusts, *forces])

    def write(self, path: str) -> None:
        """The table as CSV, names and units in its first line. Raises ConfigError."""
        try:
            with open(path, "w", newline="") as file:
                writer = csv.writer(file)
                writer.writerow(self.columns)
                writer.writerows([f"{x:.9g}" for x in row] for row in self.rows)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None

    def draw(self, path: str) -> None:
        """The picture: track, depth, attitude, speeds, thrusts, and the forces of each kind.

        Raises ConfigError, MissingExtraError.
        """
        plt = pyplot()
        figure, axes = plt.subplots(4, 2, figsize=(13, 14), layout="constrained")
        (track, surge, depth, pitch), (speed, heave, thrust, yaw) = axes[:, 0], axes[:, 1]
        self._draw_track(track)
        self._lines(depth, {"depth": "down_m"}, "m")
        depth.invert_yaxis()
        self._lines(speed, {"surge u": "u_m_s", "sway v": "v_m_s", "heave w": "w_m_s"}, "m/s")
        names = [name for name in self.columns if name.startswith("thrust_")]
        self._lines(thrust, {name[7:-2].replace("_", " "): name for name in names}, "thrust (N)")
        for panel, axis, words in (
            (surge, "x_n", "force along x (N)"),
            (heave, "z_n", "force along z (N)"),
            (pitch, "m_nm", "pitch moment (N m)"),
            (yaw, "n_nm", "yaw moment (N m)"),
        ):
            self._lines(panel, {term.replace("_", " "): f"{term}_{axis}" for term in Forces._fields}, words)
        figure.suptitle(self.title)
        try:
            figure.savefig(path, dpi=100)
        except (OSError, ValueError) as error:
            raise ConfigError(f"{path}: cannot be written: {error}") from None
        finally:
            plt.close(figure)

    def _draw_track(self, axes: Any) -> None:
        axes.plot(self._column("east_m"), self._column("north_m"))
        axes.plot(*[self._column(name)[0] for name in ("east_m", "north_m")], "o", color="C2")
        axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal", title="track")

    def _lines(self, axes: Any, curves: dict[str, str], unit: str) -> None:
        time = self._column("time_s")
        for label, name in curves.items():
            values = self._column(name)
            if any(values):  # a term that is never there needs no line
                axes.plot(time, values, label=label, linewidth=1.0, color="black" if label == "total" else None)
        axes.set(xlabel="time (s)", ylabel=unit)
        if axes.lines:
            axes.legend(loc="upper right", fontsize="x-small", ncols=2)

    def _column(self, name: str) -> list[float]:
        place = self.columns.index(name)
        return [row[place] for row in self.rows]
