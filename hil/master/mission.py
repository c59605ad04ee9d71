"""Flying a plan with a vehicle somewhere on the network."""

import select
import time

from hil.autonomy.control import VelocityCommand
from hil.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns
from hil.errors import NetworkError
from hil.master.client import VehicleClient
from hil.master.planner import Navigator, Outcome
from hil.master.progress import Progress
from hil.master.recorder import TrackWriter

GONE_AFTER_S = 1.0
GIVE_UP_AFTER_S = 10.0


class Mission:
    """Flies with one vehicle, a command every `command_period` s."""

    def __init__(
        self,
        navigator: Navigator,
        command_period: float,
        client: VehicleClient,
        track: TrackWriter,
        progress: Progress,
    ) -> None:
        self._navigator = navigator
        self._period_ns = seconds_ns(command_period)
        self._client = client
        self._track = track
        self._progress = progress

    def fly(self, stop_fd: int) -> Outcome:
        """Fly until the goal, the time limit or a stop signal. Raises NetworkError when the vehicle stays away."""
        began, cpu_began = now_ns(), time.process_time()
        schedule = RateKeeper(self._period_ns, began)
        reason = ""
        while not reason:
            wait = max(schedule.deadline_ns - now_ns(), 0) / NS_PER_S
            if select.select((stop_fd,), (), (), wait)[0]:
                reason = "stopped by the user"
            elif schedule.due(now_ns()):
                elapsed = (now_ns() - began) / NS_PER_S
                reason = self._tick(elapsed)
        self._client.command(VelocityCommand())
        return self._navigator.outcome(reason, (now_ns() - began) / NS_PER_S, time.process_time() - cpu_began)

    def _tick(self, elapsed: float) -> str:
        """One command; why the mission ends, or "" to go on."""
        odometry, truth = self._client.latest.get("odom"), self._client.latest.get("ground_truth")
        if odometry is None or truth is None:
            return ""
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
        command = self._navigator.command(odometry.value)
        self._client.command(command)
        reason = self._navigator.judge(elapsed, truth.value)
        self._track.row(elapsed, truth.value, odometry.value, command)
        self._progress.show(elapsed, truth.value, self._navigator.progress, self._client)
        return reason
