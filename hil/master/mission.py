"""Letting a planner fly a vehicle somewhere on the network."""

import select
import time
from typing import Any

from hil.autonomy.control import VelocityCommand
from hil.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns
from hil.errors import ConfigError, NetworkError
from hil.master.client import VehicleClient
from hil.master.flight import Flight, Outcome
from hil.master.planner import Planner
from hil.master.progress import Progress
from hil.master.recorder import TrackWriter
from hil.schema import nearest
from hil.topics import ALL, TOPICS

GONE_AFTER_S = 1.0
GIVE_UP_AFTER_S = 10.0
STOPPED = "stopped by the user"
_NOT_SENSED = ("ground_truth", "diagnostics", "cmd_vel")


def topics_of(planner: Planner) -> tuple[str, ...]:
    """What has to be listened to for a mission with this planner. Raises ConfigError for what is no topic."""
    name, listens = type(planner).__name__, planner.listens
    if isinstance(listens, str):
        raise ConfigError(f"{name}: listens = {listens!r}: expected a tuple of topics, such as ({listens!r},)")
    for topic in listens:
        if topic != ALL and topic not in TOPICS:
            raise ConfigError(f"{name}: listens: no topic {topic!r}{nearest(topic, list(TOPICS))}")
    return ("odom", "ground_truth", *listens)


class Mission:
    """Flies with one vehicle, a command every `command_period` s."""

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

    def fly(self, stop_fd: int) -> Outcome:
        """Fly until the planner is done, the time limit or a stop signal.

        Raises NetworkError when the vehicle stays away.
        """
        began, cpu_began = now_ns(), time.process_time()
        schedule = RateKeeper(self._period_ns, began)
        reason = ""
        while not reason:
            wait = max(schedule.deadline_ns - now_ns(), 0) / NS_PER_S
            if select.select((stop_fd,), (), (), wait)[0]:
                reason = STOPPED
            elif schedule.due(now_ns()):
                elapsed = (now_ns() - began) / NS_PER_S
                reason = self._tick(elapsed)
        self._client.command(VelocityCommand())
        return self._flight.outcome((now_ns() - began) / NS_PER_S, time.process_time() - cpu_began, reason)

    def _tick(self, elapsed: float) -> str:
        """One command; why the mission ends, or "" to go on."""
        odometry = self._client.latest.get("odom")
        if odometry is None:
            return ""
        truth = self._client.latest.get("ground_truth", odometry)  # a real vehicle has none
        if odometry.age_s > GIVE_UP_AFTER_S:
            raise NetworkError(
                f"{self._client.node} at {self._client.endpoint} is gone for {odometry.age_s:.0f} s; "
                "look at the slave and at the network between"
            )
        if odometry.age_s > GONE_AFTER_S:
            self._progress.note(f"no word from the vehicle for {odometry.age_s:.1f} s, waiting for it")
            return ""
        refusal = self._client.refusal()
        if refusal:
            raise NetworkError(refusal)
        command = self._flight.command(elapsed, self._samples(), truth.value)
        self._client.command(command)
        self._track.row(elapsed, truth.value, odometry.value, command)
        self._progress.show(elapsed, truth.value, self._flight.planner.progress, self._client)
        return self._flight.reason

    def _samples(self) -> dict[str, Any]:
        """What the vehicle's sensors say; the truth and figures of health are none of a planner's business."""
        latest = self._client.latest.copy()  # the readers add to it
        return {topic: stamped.value for topic, stamped in latest.items() if topic not in _NOT_SENSED}
