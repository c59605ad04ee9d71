"""Let a planner control a vehicle over the network."""

from typing import Any

import psutil

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.common.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns, to_wall_ns
from hil.common.errors import NetworkError
from hil.common.stop import is_stopped
from hil.master.flight import Flight, Outcome
from hil.master.progress import Progress
from hil.master.recorder import TrackWriter
from sim.run_events import RunEvent

LOST_AFTER_S = 1.0
GIVE_UP_AFTER_S = 10.0
FINAL_FIGURES_S = 3.0  # longest wait for the vehicle's diagnostics from after the flight; they come every second
POLL_S = 0.02
STOPPED = "stopped by the user"
_NOT_SENSED = ("ground_truth", "diagnostics", "cmd_vel", "plan")
PLAN_PERIOD_S = 1.0  # period of publishing an unchanged path again, for late joiners


class Mission:
    """Control one vehicle: send a command every `command_period` s."""

    def __init__(
        self,
        flight: Flight,
        command_period: float,
        client: VehicleClient,
        track: TrackWriter,
        progress: Progress,
    ) -> None:
        self._flight = flight
        self._period_ns = seconds_ns(command_period)
        self._client = client
        self._track = track
        self._progress = progress
        self._losses = client.contact.losses
        self._planned: tuple[float, Any] = -PLAN_PERIOD_S, None  # when the path was published, and that path
        self._odometry_s = 0.0  # time of the last odometry, from the start

    def fly(self, stop_fd: int) -> Outcome:
        """Fly until the planner is done, the time limit is reached or `stop_fd` becomes readable.

        Raises NetworkError if the vehicle does not answer, sends no odometry, or does not accept commands.
        """
        began, cpu_began = now_ns(), _cpu_s()
        schedule = RateKeeper(self._period_ns, began)
        reason = ""
        while not reason:
            wait = max(schedule.deadline_ns - now_ns(), 0) / NS_PER_S
            if is_stopped(stop_fd, wait):
                reason = STOPPED
            elif schedule.due(now_ns()):
                elapsed = (now_ns() - began) / NS_PER_S
                reason = self._tick(elapsed)
        self._client.command(VelocityCommand())
        duration, cpu_s = (now_ns() - began) / NS_PER_S, _cpu_s() - cpu_began
        if reason != STOPPED:
            self._await_final_figures(stop_fd)
        return self._flight.outcome(duration, cpu_s, reason, self._events(began, duration))

    def _await_final_figures(self, stop_fd: int) -> None:
        """Wait until the vehicle has reported its events up to the end of the run."""
        ended = now_ns()
        deadline = ended + seconds_ns(FINAL_FIGURES_S)
        while now_ns() < deadline and self._client.diagnostics().run_events is not None:
            if self._client.latest["diagnostics"].sent_ns > ended:
                return
            if is_stopped(stop_fd, POLL_S):
                return
        if self._client.diagnostics().run_events is not None:
            age = self._client.latest["diagnostics"].age_s
            self._progress.print_line(f"{self._client.node} last reported its contacts and link {age:.1f} s ago")

    def _events(self, began: int, duration: float) -> list[RunEvent]:
        """Return the events that the vehicle reported, cut off at the end of the flight of `duration` s."""
        ended = seconds_ns(duration)
        events = [event for event in self._client.run_events(began) if event.start_ns <= ended]
        return [event._replace(duration_ns=min(event.end_ns, ended) - event.start_ns) for event in events]

    def _tick(self, elapsed: float) -> str:
        """Send one command; return why the mission ends, or "" to continue."""
        refusal = self._client.unavailable_reason()
        if refusal:
            raise NetworkError(refusal)
        odometry = self._client.latest.get("odom")
        if odometry is None:
            self._miss_odometry(elapsed)
            return ""
        self._watch_link(elapsed, odometry.age_s)
        truth = self._client.latest.get("ground_truth", odometry)  # a real vehicle sends no truth
        if odometry.age_s > GIVE_UP_AFTER_S:
            raise NetworkError(
                f"{self._client.node} at {self._client.endpoint} has not answered for {odometry.age_s:.0f} s; "
                "check the slave and the network between"
            )
        if odometry.age_s > LOST_AFTER_S:
            self._progress.print_limited(f"no odometry from the vehicle for {odometry.age_s:.1f} s, waiting for it")
            return ""
        command = self._flight.command(elapsed, self._samples(), truth.value)
        self._client.command(command)
        self._track.row(elapsed, truth.value, odometry.value, command)
        self._publish_plan(elapsed)
        self._progress.show(elapsed, truth.value, self._flight.planner.progress, self._client)
        return self._flight.reason

    def _publish_plan(self, elapsed: float) -> None:
        """Publish the planner's path for displays: a new path at once, an unchanged one every PLAN_PERIOD_S."""
        published_s, published = self._planned
        path = self._flight.planner.path
        if path and (path is not published or elapsed - published_s >= PLAN_PERIOD_S):
            from hil.ros.plan import encode_plan

            self._planned = elapsed, path
            self._client.publish("plan", encode_plan(to_wall_ns(now_ns()), path, self._flight.depth))

    def _miss_odometry(self, elapsed: float) -> None:
        """Report missing odometry. Raises NetworkError when it stays missing."""
        node = self._client.node
        if elapsed > GIVE_UP_AFTER_S:
            raise NetworkError(
                f"{node} at {self._client.endpoint} has sent no odom for {elapsed:.0f} s, and a planner needs it: give "
                "[sensors.odometry] of the slave's scenario a rate, or let the vehicle's own navigation publish odom"
            )
        if elapsed > LOST_AFTER_S:
            self._progress.print_limited(f"no odom from {node} for {elapsed:.1f} s, waiting for it")

    def _watch_link(self, elapsed: float, age: float) -> None:
        """Add an event if the link was lost; `age` is that of the last odometry, s."""
        losses = self._client.contact.losses
        if age > LOST_AFTER_S or losses != self._losses:  # lost now, or lost and restored since the last call
            self._losses = losses
            self._flight.lose_link(min(self._odometry_s, elapsed), elapsed, f"no odometry from {self._client.node}")
        else:
            self._odometry_s = max(elapsed - age, 0.0)

    def _samples(self) -> dict[str, Any]:
        """Return the newest samples of the vehicle's sensors, without ground truth and diagnostics."""
        latest = self._client.latest.copy()  # receiving threads add to it meanwhile
        return {topic: stamped.value for topic, stamped in latest.items() if topic not in _NOT_SENSED}


def _cpu_s() -> float:
    """Return the processor time (s, user and system, in steps of 10 ms) of this process."""
    times = psutil.Process().cpu_times()
    return float(times.user + times.system)
