"""The vehicle of the gateway over the network: its newest samples, and what it is asked to do.

No call waits for the network: requests that wait for answers run in a thread of their own.
"""

import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from hil.autonomy.control.controller import VelocityCommand
from hil.client import samples
from hil.client.client import VehicleClient
from hil.client.parameters import read_parameters, set_parameter
from hil.common.errors import HilError, NetworkError
from hil.gateways.mavlink.snapshot import Command, Echo, Snapshot, ThrusterTest
from hil.network.services import call
from hil.ros.commands import PoseCommand, encode_pose, encode_thrusts
from hil.ros.frames import encode_wrench
from hil.ros.joints import encode_accessories
from sim.sensors.extra_samples import BatterySample, FixSample

TOPICS = ("odom", "pressure", "battery", "gps", "altitude", "altimeter", "leak", "motors", "imu", "magnetometer")
STALE_S = 1.0  # after which a vehicle whose position does not come counts as lost
SLOW_STALE_S = 3.0  # the same for samples that come once a second
DVL_REACH = 0.05, 200.0  # m: its messages do not state it
REFRESH_S = 5.0  # between two queries of the slave's sensors and parameters
# A gain of the slave, gains.surge.p, is HIL_G_SURGE_P; ArduSub has some of them, too.
AXES = {
    "surge": "SURGE", "sway": "SWAY", "heave": "HEAVE", "roll_rate": "RLLR", "pitch_rate": "PITR", "yaw_rate": "YAWR",
    "depth": "DEPTH", "heading": "HDG", "roll": "ROLL", "pitch": "PITCH",
}  # fmt: skip
FIELDS = {
    "p": "P", "i": "I", "d": "D", "limit": "LIM", "feedforward": "FF", "filter": "FILT", "slew": "SLEW",
}  # fmt: skip
SAME_AS_ARDUSUB = {
    "gains.heading.p": "ATC_ANG_YAW_P", "gains.roll.p": "ATC_ANG_RLL_P", "gains.pitch.p": "ATC_ANG_PIT_P",
    "gains.depth.p": "PSC_POSZ_P",
}  # fmt: skip
NAMES = {
    f"gains.{axis}.{field}": SAME_AS_ARDUSUB.get(f"gains.{axis}.{field}", f"HIL_G_{short}_{word}")
    for axis, short in AXES.items() for field, word in FIELDS.items()
}  # fmt: skip


class NetworkVehicle:
    """One vehicle, through its client. Use as a context manager; leaving it ends the thread, not the client.

    `report` gets a line when the vehicle is there for the first time.
    """

    def __init__(self, client: VehicleClient, report: Callable[[str], None] = lambda _: None) -> None:
        self._client, self._report = client, report
        self._gains: dict[str, float] = {}  # by their names in MAVLink
        self._jobs: deque[Callable[[], None]] = deque()
        self._wake = threading.Event()
        self._ending = threading.Event()
        self._settled: deque[tuple[str, str]] = deque()
        self._sensors: frozenset[str] = frozenset()
        self._shares: dict[str, float] = {}  # of accessories, as sent
        self._is_known = False  # whether its sensors and parameters were queried since it appeared
        client.watch(*TOPICS)
        self._thread = threading.Thread(target=self._work, name="mavlink requests", daemon=True)
        self._thread.start()

    def __enter__(self) -> "NetworkVehicle":
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._wake.set()
        self._thread.join(5.0)

    def snapshot(self) -> Snapshot | None:
        """Return its newest samples; None while it is absent, or its sensors and parameters are not known yet."""
        client = self._client
        odometry = client.latest.get("odom")
        if not client.contact.present or odometry is None or odometry.age_s > STALE_S or not self._is_known:
            self._is_known &= client.contact.present
            self._shares.clear()  # a vehicle that was started again has its own
            return None
        figures = client.diagnostics()
        stamped = client.latest.get("motors")
        motors = stamped.value if stamped and stamped.age_s <= STALE_S else ()
        battery, fix = self._newest("battery", SLOW_STALE_S), self._newest("gps", SLOW_STALE_S)
        pressure, leak = self._newest("pressure", STALE_S), self._newest("leak", SLOW_STALE_S)
        return Snapshot(
            samples.aged("odom", odometry),
            battery if isinstance(battery, BatterySample) else None,
            pressure.pascal if pressure else None,
            self._echo(),
            fix if isinstance(fix, FixSample) else None,
            bool(leak),
            tuple([round(motor.pulse_us) for motor in motors]) or figures.pwm_us or (),
            motors,
            self._sensors,
            (figures.cpu_s or 0.0) / max(figures.uptime_s or 0.0, 1.0),
            bool(figures.stm32_silent),
            self._newest("imu", STALE_S),
            field.field if (field := self._newest("magnetometer", STALE_S)) else None,
            figures.armed is False,
        )

    def send(self, command: Command) -> None:
        """Send a command once; the vehicle forgets it after its deadman's time."""
        client = self._client
        try:
            if isinstance(command, VelocityCommand):
                client.command(command)
            elif isinstance(command, PoseCommand):
                client.send("cmd_pose", encode_pose(command, 0))
            elif isinstance(command, ThrusterTest) or not any(command):
                number, thrust = command if isinstance(command, ThrusterTest) else (0, 0.0)
                thrusters = range(client.diagnostics().thrusters or 0)
                client.send("cmd_thrusters", encode_thrusts([thrust * (n == number) for n in thrusters]))
            else:
                client.send("cmd_wrench", encode_wrench(0, command))
        except NetworkError:  # several vehicles of its name: `refusal` reports it
            return

    def refusal(self) -> str:
        """Return why it does not execute our commands, with the remedy; "" if it does."""
        client, figures = self._client, self._client.diagnostics()
        if figures.controller == "autopilot":
            return f"{client.node} is flown by {figures.autopilot}: connect to that autopilot's own port"
        reason = client.unavailable_reason()
        return reason or (f"{client.node} has just named another master" if client.in_doubt else "")

    def arm(self) -> None:
        """Let the slave take commands again, if it was disarmed; `refusal` shows when it does."""
        if self._client.diagnostics().armed is False:
            self._do(self._call_arm)

    def set_accessory(self, name: str, share: float) -> None:
        """Move an accessory: "lights" (0 to 1), "camera_tilt" (-1 to 1, up) or "gripper" (-1 to 1, open).

        RC channels repeat their command, which is sent once.
        """
        if self._shares.get(name) != share:
            with suppress(NetworkError):  # several vehicles of its name: `refusal` reports it
                self._client.send("cmd_accessories", encode_accessories(0, {name: share}))
                self._shares[name] = share

    def parameters(self) -> Mapping[str, float]:
        """Return the gains of the slave's controller, by their MAVLink names; empty until they came."""
        return self._gains

    def set_parameter(self, name: str, value: float) -> None:
        """Begin to set one of them; `parameters` has its value when that is done."""

        def set_one() -> None:
            try:
                gain = next(gain for gain, short in NAMES.items() if short == name)
                reason = set_parameter(self._client.session, self._client.node, gain, value)
                self._refresh()
            except HilError as error:
                reason = str(error)
            self._settled.append((name, f"{name}: {reason}" if reason else ""))

        self._do(set_one)

    def pop_settled(self) -> list[tuple[str, str]]:
        """Return the parameters that were set since the last call, or could not be: name, and why not."""
        settled = []
        while self._settled:
            settled.append(self._settled.popleft())
        return settled

    def _newest(self, topic: str, within_s: float) -> Any:
        stamped = self._client.latest.get(topic)
        return samples.aged(topic, stamped) if stamped and stamped.age_s <= within_s else None

    def _echo(self) -> Echo | None:
        altimeter = self._newest("altimeter", STALE_S)
        if altimeter:
            return Echo(altimeter.distance, *altimeter.limits)
        altitude = self._newest("altitude", STALE_S)
        return Echo(altitude.distance, *DVL_REACH) if altitude else None

    def _call_arm(self) -> None:
        call(self._client.session, f"/{self._client.node}/arm", "std_srvs/srv/SetBool", {"data": True})

    def _do(self, job: Callable[[], None]) -> None:
        self._jobs.append(job)
        self._wake.set()

    def _work(self) -> None:
        """Do the requests that wait for answers, and query the slave's sensors and parameters every REFRESH_S."""
        was_here = False
        while not self._ending.is_set():
            while self._jobs:
                self._attempt(self._jobs.popleft())
            if self._client.contact.present:
                self._attempt(self._refresh)
                if not was_here:
                    was_here = True
                    self._report(f"connected: {self._client.node}")
            self._wake.wait(REFRESH_S if self._is_known else 0.1)
            self._wake.clear()

    def _refresh(self) -> None:
        try:
            self._sensors = frozenset(self._client.offers())
            values = read_parameters(self._client.session, self._client.node, NAMES)
            self._gains = {short: values[gain] for gain, short in NAMES.items() if gain in values}
        finally:
            self._is_known = True

    def _attempt(self, job: Callable[[], None]) -> None:
        try:
            job()
        except HilError:  # the network is down, or the slave has no services: what is known stays
            return
