"""What a recording says of each vehicle, as columns over time: the material of its figures."""

from collections.abc import Iterable

from hil.master.delay import INSTANTS, DelayMeter
from hil.transport import ros
from hil.transport.recording_file import PULSES, Message
from sim.rotations import to_euler
from sim.sensors.samples import OdometrySample

NS_PER_S = 1e9
Row = tuple[float, ...]


class VehicleData:
    """One vehicle. In every row the time comes first: seconds since the recording began.

    `true` and `measured`: north, east, depth (m), yaw (rad), surge, sway, heave (m/s), yaw rate (rad/s); `commands`:
    surge, sway, heave (m/s), yaw rate (rad/s); `pulses`: one a channel (us). `traced` are the times of `delays`.
    """

    def __init__(self) -> None:
        self.true: list[Row] = []
        self.measured: list[Row] = []
        self.commands: list[Row] = []
        self.pulses: list[Row] = []
        self.traced: list[float] = []
        self.delays = DelayMeter(kept=0)
        self.boot_id = ""


def collect(messages: Iterable[Message]) -> dict[str, VehicleData]:
    """The data of each node of a recording; nodes of which nothing is known are left out."""
    found: dict[str, VehicleData] = {}
    first_ns = 0
    for message in messages:
        first_ns = first_ns or message.logged_ns
        node, _, name = message.topic.strip("/").rpartition("/")
        take = _TAKERS.get(name)
        if node and take:
            take(found.setdefault(node, VehicleData()), message, (message.logged_ns - first_ns) / NS_PER_S)
    for data in found.values():
        data.pulses = _steps(
            data.pulses, max((rows[-1][0] for rows in (data.true, data.commands) if rows), default=0.0)
        )
    return found


def _take_true(data: VehicleData, message: Message, time: float) -> None:
    sample = ros.decode_odometry(message.data)
    if sample:
        data.true.append((time, *_state(sample)))


def _take_measured(data: VehicleData, message: Message, time: float) -> None:
    sample = ros.decode_odometry(message.data)
    if sample:
        data.measured.append((time, *_state(sample)))


def _take_command(data: VehicleData, message: Message, time: float) -> None:
    twist = ros.decode_twist(message.data)
    if twist:
        data.commands.append((time, *twist[0], twist[1][2]))


def _take_pulses(data: VehicleData, message: Message, time: float) -> None:
    values = ros.decode_int64_array(message.data)
    if values:
        data.pulses.append((time, *map(float, values[1:])))


def _take_diagnostics(data: VehicleData, message: Message, time: float) -> None:
    """The pulses of once a second, where the recording is not the slave's own."""
    statuses = ros.decode_diagnostics(message.data)
    values = statuses[0][3] if statuses else {}
    data.boot_id = values.get("boot_id", data.boot_id)
    words = values.get("pwm_us", "").split()
    if words and all(word.isdigit() for word in words):
        data.pulses.append((time, *map(float, words)))


def _take_trace(data: VehicleData, message: Message, time: float) -> None:
    instants = ros.decode_int64_array(message.data)
    if instants and len(instants) in INSTANTS:
        data.delays.add(list(instants), message.published_ns, message.logged_ns)
        data.traced.append(time)


def _state(sample: OdometrySample) -> Row:
    u, v, w, _, _, r = sample.nu
    return (*sample.position, to_euler(sample.orientation)[2], u, v, w, r)


def _steps(rows: list[Row], end: float) -> list[Row]:
    """The last of them holds until the end."""
    if not rows:
        return rows
    most = max(len(row) for row in rows)
    kept = [row for row in rows if len(row) == most]
    return [*kept, (max(end, kept[-1][0]), *kept[-1][1:])]


_TAKERS = {
    "ground_truth": _take_true,
    "odom": _take_measured,
    "cmd_vel": _take_command,
    PULSES.name: _take_pulses,
    "diagnostics": _take_diagnostics,
    "trace": _take_trace,
}
