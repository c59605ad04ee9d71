"""Convert a recording to columns over time for each vehicle, for figures."""

from collections.abc import Callable, Iterable

from hil.client.delay import INSTANTS, DelayMeter
from hil.common.errors import ConfigError
from hil.common.vectors import Vector3
from hil.recording.mcap_file import CLOCK_SHIFT, PULSES, Message
from hil.ros import encoders as ros
from hil.ros.diagnostics import Diagnostics
from hil.ros.joints import decode_joints
from hil.ros.plan import decode_plan
from sim.rotations import to_euler
from sim.run_events import RunEvent, events_since

NS_PER_S = 1e9
MAX_ROWS = 200_000  # in a column; far more than a figure has pixels
MAX_VEHICLES = 64
LONGEST = 1 << 20  # bytes of a message with a state, a command or diagnostics; usual ones have some thousand
Row = tuple[float, ...]


class Rows(list[Row]):
    """Rows in order of time. At MAX_ROWS every second row is removed, and later rows are thinned out likewise."""

    def __init__(self) -> None:
        super().__init__()
        self._every, self._count = 1, 0

    def append(self, row: Row) -> None:
        """Add a row at the end, unless it is thinned out."""
        if self._count % self._every == 0:
            super().append(row)
        self._count += 1
        if len(self) >= MAX_ROWS:
            del self[1::2]
            self._every *= 2


class VehicleData:
    """Data of one vehicle. Every row begins with the time: seconds since the recording began.

    `true` and `measured`: north, east, depth (m), yaw (rad), surge, sway, heave (m/s), yaw rate (rad/s). `commands`:
    surge, sway, heave (m/s), yaw rate (rad/s). `pulses`: one per channel (us). `traced`: times of the samples of
    `delays`. `channels`: names of thrusters, then fins.
    `events`: the events that the vehicle reported. `tether`: last shape of its tether (NED, m).
    """

    def __init__(self) -> None:
        self.true: list[Row] = Rows()
        self.measured: list[Row] = Rows()
        self.commands: list[Row] = Rows()
        self.pulses: list[Row] = Rows()
        self.traced: list[float] = []
        self.delays = DelayMeter(min_commands=MAX_ROWS)
        self.boot_id = ""
        self.channels: tuple[str, ...] = ()
        self.events: tuple[RunEvent, ...] = ()
        self.tether: tuple[Vector3, ...] = ()
        self.shift_ns = 0  # of the recorder's wall clock since the start


def collect(messages: Iterable[Message], path: str) -> dict[str, VehicleData]:
    """Return the data of each node in a recording; nodes without data are left out. `path`: for errors.

    Raises ConfigError if there are more than MAX_VEHICLES.
    """
    vehicles: dict[str, VehicleData] = {}
    first_ns = 0
    for message in messages:
        first_ns = first_ns or message.logged_ns
        node, _, name = message.topic.strip("/").rpartition("/")
        handle = _HANDLERS.get(name)
        if name == CLOCK_SHIFT.name and (shift := ros.decode_int64_array(message.data)):
            for data in vehicles.values():
                data.shift_ns = shift[0]
        if node and handle and len(message.data) <= LONGEST:
            if node not in vehicles and len(vehicles) >= MAX_VEHICLES:
                raise ConfigError(f"{path}: has more than {MAX_VEHICLES} vehicles, too many for a figure")
            handle(vehicles.setdefault(node, VehicleData()), message, (message.logged_ns - first_ns) / NS_PER_S)
    for data in vehicles.values():
        data.pulses = _steps(
            data.pulses, max((rows[-1][0] for rows in (data.true, data.commands) if rows), default=0.0)
        )
    return vehicles


def _add_state(rows: list[Row], message: Message, time: float) -> None:
    sample = ros.decode_odometry(message.data)
    if sample:
        u, v, w, _, _, r = sample.nu
        rows.append((time, *sample.position, to_euler(sample.orientation)[2], u, v, w, r))


def _add_command(data: VehicleData, message: Message, time: float) -> None:
    twist = ros.decode_twist(message.data)
    if twist:
        data.commands.append((time, *twist[0], twist[1][2]))


def _add_pulses(data: VehicleData, message: Message, time: float) -> None:
    values = ros.decode_int64_array(message.data)
    if values:
        data.pulses.append((time, *map(float, values[1:])))


def _add_diagnostics(data: VehicleData, message: Message, time: float) -> None:
    """Add the pulse widths of the diagnostics, one row per second, for a recording that the slave did not make."""
    statuses = ros.decode_diagnostics(message.data)
    figures = Diagnostics(statuses[0][3] if statuses else {})
    data.boot_id = figures.boot_id or data.boot_id
    if figures.pwm_us:
        data.pulses.append((time, *map(float, figures.pwm_us)))
    data.events = events_since(figures.run_event_list or (), message.published_ns - round(time * NS_PER_S))


def _add_trace(data: VehicleData, message: Message, time: float) -> None:
    instants = ros.decode_int64_array(message.data)
    if instants and len(instants) == INSTANTS:
        data.delays.add(list(instants), message.published_ns, message.logged_ns + data.shift_ns)
        data.traced.append(time)
        if len(data.traced) > data.delays.stored:  # the meter has dropped the oldest
            data.traced = data.traced[-data.delays.stored :]


def _add_channels(data: VehicleData, message: Message, _time: float) -> None:
    if not data.channels and (joints := decode_joints(message.data)):
        data.channels = joints.names


def _add_tether(data: VehicleData, message: Message, _time: float) -> None:
    data.tether = decode_plan(message.data) or data.tether


def _steps(rows: list[Row], end: float) -> list[Row]:
    """Return the values over time as steps; the last value is held until the end."""
    if not rows:
        return rows
    most = max(len(row) for row in rows)
    complete = [row for row in rows if len(row) == most]
    return [*complete, (max(end, complete[-1][0]), *complete[-1][1:])]


_HANDLERS: dict[str, Callable[[VehicleData, Message, float], None]] = {
    "ground_truth": lambda data, message, time: _add_state(data.true, message, time),
    "odom": lambda data, message, time: _add_state(data.measured, message, time),
    "cmd_vel": _add_command,
    "joint_states": _add_channels,
    PULSES.name: _add_pulses,
    "diagnostics": _add_diagnostics,
    "trace": _add_trace,
    "tether": _add_tether,
}
