"""Target hunting case: four vehicles start in formation and surround a target, using reports of their neighbours.

In SIL all vehicles run in one process and in simulated time; in HIL there are four slaves, four agents and an observer.
"""

import os
from collections.abc import Sequence

from hil.cases.case import Case
from hil.cases.hunt import processes
from hil.cases.hunt.simulated import SimulatedHunt
from hil.cases.hunt.watch import HuntWatch, modem_figures
from hil.cases.record import Mode, Run, Track
from hil.common.ports import free_ports
from hil.common.tables import csv_text, save_text
from hil.master.hunt import HuntPlanner
from hil.scenario.config import Scenario, load_scenario
from hil.scenario.variant import Table, write_variant


class TargetHunting(Case):
    """Target hunting, from a line abreast or a diamond, over the network or with acoustic modems."""

    def fly(self, mode: Mode, seed: int, folder: str) -> Run:
        """Fly once, as `Case.fly` documents. The seed varies the noise of sensors and of localisation."""
        members = {"member": members_on_free_ports(self.scenario)} if mode == "hil" else {}
        file = write_variant(self.scenario, folder, {"seed": seed, **members})
        scenario = load_scenario(file)
        watch = HuntWatch(scenario, self.show)
        figures = (self._simulate if mode == "sil" else self._fly_processes)(scenario, folder, watch)
        write_rows(os.path.join(folder, "track.csv"), scenario, watch)
        return Run(watch.result(self.name, mode, figures), tracks_of(scenario, watch), file)

    def draw(self, runs: Sequence[Run], path: str) -> None:
        """Draw the paper's figure: paths, formation, target and ring, and the distances between vehicles over time."""
        from hil.cases.hunt.picture import draw_hunt

        draw_hunt(self.about["title"], runs, path)

    def _simulate(self, scenario: Scenario, folder: str, watch: HuntWatch) -> dict[str, float]:
        hunt = SimulatedHunt(scenario, watch)
        with self.viewer.show_simulated(scenario, dict(zip(hunt.nodes, hunt.vehicles, strict=True))) as shown:
            hunt.run(shown)
        messages = modem_figures(hunt.channel.counts if hunt.channel else {})
        return {"energy": hunt.energy, "planner_cpu": hunt.planner_cpu_s / hunt.time, **messages}

    def _fly_processes(self, scenario: Scenario, folder: str, watch: HuntWatch) -> dict[str, float]:
        with self.viewer.show_slaves(scenario):
            return processes.fly(scenario, folder, watch)


def members_on_free_ports(scenario: str) -> list[Table]:
    """Return the [[member]] tables of a scenario, with all endpoints on free ports of this machine.

    Raises ConfigError.
    """
    members = load_scenario(scenario).member
    ports = iter(free_ports(2 * len(members)))
    return [
        {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in member._asdict().items()
            if value not in (None, "")
        }
        | {"listen": f"tcp/127.0.0.1:{next(ports)}", "agent": f"tcp/127.0.0.1:{next(ports)}"}
        for member in members
    ]


def tracks_of(scenario: Scenario, watch: HuntWatch) -> tuple[Track, ...]:
    """Return the true track and the planned path of each vehicle; without speeds, as the vehicles move sideways."""
    time = [row.time for row in watch.rows]
    tracks = []
    for number, member in enumerate(scenario.member):
        north, east = zip(*(row.positions[number] for row in watch.rows), strict=True)
        tracks.append(Track(member.node, time, north, east, (), (), tuple(HuntPlanner(scenario, number).track)))
    return tuple(tracks)


def write_rows(path: str, scenario: Scenario, watch: HuntWatch) -> None:
    """Write all rows as CSV: time, and for each vehicle its true position and its clock of the plan (s)."""
    names = ("true_north_m", "true_east_m", "plan_s")
    rows = [["time_s", *(f"{member.node}_{name}" for member in scenario.member for name in names)]]
    for row in watch.rows:
        figures = [x for (n, e), clock in zip(row.positions, row.clocks, strict=True) for x in (n, e, clock)]
        rows.append([f"{x:.4f}" for x in (row.time, *figures)])
    save_text(path, csv_text(rows))
