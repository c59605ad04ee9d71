"""Target hunting case: four vehicles start in formation and surround a target, using reports of their neighbours.

In SIL all vehicles run in one process and in simulated time; in HIL there are four slaves, four agents and an observer.
"""

import os
from collections.abc import Mapping, Sequence
from math import degrees, nan

from hil.cases.case import Case
from hil.cases.hunt import processes
from hil.cases.hunt.simulated import SimulatedHunt
from hil.cases.hunt.watch import HuntOutcome, HuntWatch
from hil.cases.record import Mode, Result, Run, Track
from hil.cases.single import radius_of
from hil.cases.viewer import Viewer
from hil.client.delay import quantiles
from hil.common.ports import free_ports
from hil.common.tables import csv_text, save_text
from hil.master.hunt import HuntPlanner
from hil.scenario.config import Scenario, load_scenario
from hil.scenario.variant import Table, write_variant
from sim.vehicle.vehicle import load_vehicle


class TargetHunting(Case):
    """Target hunting that starts from a line abreast."""

    name = "target_hunting"
    scenario = "target_hunting"
    title = 'Target hunting from the formation "line"'
    paper = (
        "Figure 13 (a, c): four vehicles start at (0, 0), (3, 0), (6, 0) and (9, 0) in 10 m x 10 m. They approach the "
        "target at (5, 8) in formation and surround it. Artificial potential fields (eqs 4 to 9) control them, with "
        "localisation noise."
    )
    method = (
        "Every vehicle has a planner of its own, in HIL in a process of its own. A planner knows:\n\n"
        "- the plan that all agreed on before the dive: each place at any time (the virtual structure)\n"
        "- its own position\n"
        "- what planners within 5 m publish ten times a second on the topic `formation`; in the line only the next "
        "vehicle is that near\n\n"
        "Its velocity is the sum of the paper's fields:\n\n"
        "| field | effect |\n| --- | --- |\n"
        "| attraction | towards the place |\n"
        "| repulsion | away from vehicles and from the target |\n"
        "| range | neighbours stay within range |\n"
        "| structure | the velocity of the place is added |\n\n"
        "The fields have their standard forms; docs/explanation/reference_platform.md says why not "
        "as printed. The plan's clock runs slower while the vehicle or a neighbour lags.\n\n"
        "The position is that of the navigation. Its error drifts (0.1 m). Gaussian white noise of 5 cm an axis is "
        "added: the error of the paper's eq. (10), as printed, is never below its amplitude and has no bound. The "
        "position of the target has no error"
    )
    criterion = (
        "All by true positions:\n\n"
        "- No two vehicles' middles come nearer than 0.5 m.\n"
        "- On the approach no vehicle is more than 0.5 m from its place.\n"
        "- At the end all are within 0.375 m of the ring: a quarter of its radius, and the length of a vehicle.\n"
        "- Their spacing is even to 25 %.\n"
        "- No gap round the target exceeds 115 degrees"
    )

    def fly(self, mode: Mode, seed: int, folder: str) -> Run:
        """Fly once, as `Case.fly` documents. The seed varies the noise of sensors and of localisation."""
        members = {"member": members_on_free_ports(self.scenario)} if mode == "hil" else {}
        file = write_variant(self.scenario, folder, {"seed": seed, **members})
        scenario = load_scenario(file)
        watch = HuntWatch(scenario, self.show)
        figures = (_simulate if mode == "sil" else _fly_processes)(scenario, folder, watch, self.viewer)
        write_rows(os.path.join(folder, "track.csv"), scenario, watch)
        return Run(self._result(mode, seed, scenario, watch.outcome(), figures), tracks_of(scenario, watch), file)

    def draw(self, runs: Sequence[Run], path: str) -> None:
        """Draw the paper's figure: paths, formation, target and ring, and the distances between vehicles over time."""
        from hil.cases.hunt.picture import draw_hunt

        draw_hunt(self.title, runs, path)

    def _result(
        self, mode: Mode, seed: int, scenario: Scenario, outcome: HuntOutcome, figures: Mapping[str, float]
    ) -> Result:
        radius = radius_of(load_vehicle(scenario.vehicle)[0])
        clearance = min(outcome.judgement.separation - radius, outcome.target_distance)
        touched = any(event.kind == "collision" for _, event in outcome.events)
        collided = touched or clearance <= radius
        return Result(
            case=self.name,
            mode=mode,
            seed=seed,
            success=outcome.success and not collided,
            reason=f"collision; {outcome.reason}" if collided and not touched else outcome.reason,
            duration=outcome.duration,
            path_length=outcome.travelled,
            optimum=outcome.optimum,
            ratio=outcome.travelled / outcome.optimum,
            least_clearance=clearance,
            collided=collided,
            energy=figures["energy"],
            cross_track_rms=outcome.place_error_rms,
            cross_track_max=outcome.place_error_max,
            goal_error=outcome.end_error,
            master_cpu=figures.get("master_cpu", nan),
            planner_cpu=figures.get("planner_cpu", nan),
            delay_p50=figures.get("delay_p50", nan),
            delay_p99=figures.get("delay_p99", nan),
            events=tuple([f"{node}: {event.describe()}" for node, event in outcome.events]),
            extra=_extra(outcome, figures),
        )


class TargetHuntingDiamond(TargetHunting):
    """Target hunting that starts from a diamond formation."""

    name = "target_hunting_diamond"
    scenario = "target_hunting_diamond"
    title = 'Target hunting from the formation "diamond"'
    paper = 'Figure 13 (b, d): the same from the formation "diamond", (4.5, 2), (3, 1), (6, 1) and (4.5, 0).'
    method = "As from the line, but all four vehicles are within range of each other from the start"
    criterion = "As from the line"


class TargetHuntingAcoustic(TargetHunting):
    """Target hunting that starts from a line abreast, with acoustic modems."""

    name = "target_hunting_acoustic"
    scenario = "target_hunting_acoustic"
    title = "Target hunting with acoustic modems"
    paper = "Figure 13 (a, c), as above. The paper does not say how its vehicles exchange their positions."
    method = (
        "As over the network, with these differences:\n\n"
        "- A report is 16 bytes. A simulated acoustic modem (docs/explanation/modems.md) sends it in its slot.\n"
        "- Each vehicle receives a report of every other once a second, a quarter of a second late.\n"
        "- Until the next report the planner extrapolates a neighbour at its reported velocity.\n"
        "- In HIL one process simulates the acoustic channel. The planners receive only what it delivers"
    )
    criterion = "As from the line"


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


def _simulate(scenario: Scenario, folder: str, watch: HuntWatch, viewer: Viewer) -> dict[str, float]:
    hunt = SimulatedHunt(scenario, watch)
    with viewer.show_simulated(scenario, dict(zip(hunt.nodes, hunt.vehicles, strict=True))) as shown:
        hunt.run(shown)
    messages = _messages(hunt.channel.counts if hunt.channel else {})
    return {"energy": hunt.energy, "planner_cpu": hunt.planner_cpu_s / hunt.time, **messages}


def _fly_processes(scenario: Scenario, folder: str, watch: HuntWatch, viewer: Viewer) -> dict[str, float]:
    with viewer.show_slaves(scenario):
        costs = processes.fly(scenario, folder, watch)
    delay = quantiles(costs.delays_ns)
    return {
        "energy": costs.energy,
        "master_cpu": costs.agents_cpu,
        "delay_p50": delay.p50_ms,
        "delay_p99": delay.p99_ms,
        "slowest slave (of real time)": costs.real_time,
        "CPU of an agent (of a core)": costs.agents_cpu / len(scenario.member),
        "CPU of a slave (of a core)": costs.slaves_cpu / len(scenario.member),
        **_messages(costs.messages),
    }


def _messages(counts: Mapping[str, int]) -> dict[str, float]:
    """Return the numbers of modem messages by outcome (sent, delivered, lost for a reason), by heading."""
    outcomes = ("sent", "delivered", "collided", "deaf", "damaged", "too_weak") if counts else ()
    return {f"modem: {outcome.replace('_', ' ')}": counts.get(outcome, 0) for outcome in outcomes}


def _extra(outcome: HuntOutcome, figures: Mapping[str, float]) -> dict[str, float]:
    """Return the results that only this case has, by heading."""
    judgement = outcome.judgement
    return {
        "least distance between two vehicles (m)": judgement.separation,
        "least distance from the target (m)": outcome.target_distance,
        "formation error (m)": judgement.formation_error,
        "ring error (m)": judgement.ring_error,
        "largest gap round the target (deg)": degrees(judgement.largest_gap),
        "spacing error on the ring (share)": judgement.spacing_error,
        "ring closed after (s)": outcome.closed,
        **{name: value for name, value in figures.items() if " " in name},
    }


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
