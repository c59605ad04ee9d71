"""Typed table of all figures in the slave's diagnostics, for writers and readers.

A figure is an attribute of `Diagnostics`, with its name on the network. Its value is typed, and None if it was not
reported. An unknown attribute raises AttributeError and is an error of the type checker; an unknown name as a string
raises KeyError. docs/reference/diagnostics.md is made from this table.
"""

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any, ClassVar, Generic, TypeVar, overload

from sim.run_events import decode_events, encode_events

T = TypeVar("T")
_FACTORS = {"us": 1e-6, "ms": 1e-3, "MiB": 2.0**20, "MHz": 1e6}  # from a unit to its base unit


class Figure(Generic[T]):
    """One figure: `name`, `unit` ("": none), `kind` (its type in words), `meaning`, and conversion to and from text.

    `is_counter`: it counts up from 0 at the start of the slave (or of the machine).
    """

    __slots__ = ("_decode", "_encode", "is_counter", "kind", "meaning", "name", "unit")
    name: str

    def __init__(
        self,
        kind: str,
        unit: str,
        meaning: str,
        encode: Callable[[T], str],
        decode: Callable[[str], T],
        is_counter: bool = False,
    ) -> None:
        self.kind, self.unit, self.meaning, self.is_counter = kind, unit, meaning, is_counter
        self._encode, self._decode = encode, decode

    def __set_name__(self, owner: type["Diagnostics"], name: str) -> None:
        self.name = name
        owner.FIGURES[name] = self

    @overload
    def __get__(self, figures: None, owner: type["Diagnostics"]) -> "Figure[T]": ...
    @overload
    def __get__(self, figures: "Diagnostics", owner: type["Diagnostics"]) -> T | None: ...
    def __get__(self, figures: "Diagnostics | None", owner: type["Diagnostics"]) -> "Figure[T] | T | None":
        return self if figures is None else self.read(figures)

    def __set__(self, figures: "Diagnostics", value: T) -> None:
        figures.raw[self.name] = self._encode(value)

    def read(self, figures: "Diagnostics") -> T | None:
        """Return the value; None if it was not reported or its text is not of this type."""
        text = figures.raw.get(self.name)
        try:
            return None if text is None else self._decode(text)
        except ValueError:
            return None

    @property
    def base_factor(self) -> float:
        """Factor from this unit to the base unit: seconds, bytes, hertz."""
        return _FACTORS.get(self.unit, 1.0)


def _number(unit: str, decimals: int, meaning: str, is_counter: bool = False) -> Figure[float]:
    return Figure("number", unit, meaning, f"{{:.{decimals}f}}".format, _decode_number, is_counter)


def _decode_number(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise ValueError(text)
    return value


def _integer(unit: str, meaning: str) -> Figure[int]:
    return Figure("integer", unit, meaning, str, int)


def _counter(meaning: str, unit: str = "") -> Figure[int]:
    return Figure("counter", unit, meaning, str, int, True)


def _flag(meaning: str) -> Figure[bool]:
    return Figure("flag", "", meaning, lambda value: str(value).lower(), _decode_flag)


def _decode_flag(text: str) -> bool:
    if text not in ("true", "false"):
        raise ValueError(text)
    return text == "true"


def _text(meaning: str) -> Figure[str]:
    return Figure("text", "", meaning, str, str)


def _texts(meaning: str, separator: str = " ") -> Figure[tuple[str, ...]]:
    kind = f'texts, separated by "{separator}"'
    return Figure(kind, "", meaning, separator.join, lambda text: tuple(filter(None, text.split(separator))))


def _integers(unit: str, meaning: str) -> Figure[tuple[int, ...]]:
    def encode(values: tuple[int, ...]) -> str:
        return " ".join(map(str, values))

    return Figure("integers", unit, meaning, encode, lambda text: tuple(map(int, text.split())))


def _by_sensor(unit: str, form: str, meaning: str, is_counter: bool = False) -> Figure[dict[str, float]]:
    def encode(values: dict[str, float]) -> str:
        return " ".join([f"{name}={value:{form}}" for name, value in values.items()])

    def decode(text: str) -> dict[str, float]:
        pairs = [word.rpartition("=") for word in text.split()]
        return {name: _decode_number(value) for name, _, value in pairs}

    return Figure("sensor=number", unit, meaning, encode, decode, is_counter)


def _by_fault(meaning: str) -> Figure[dict[str, float]]:
    by_name = _by_sensor("", ".0f", meaning)
    by_name.kind = "fault=number"
    return by_name


def or_nan(value: float | None) -> float:
    """Return a figure as a number; nan if it was not reported."""
    return float("nan") if value is None else float(value)


def to_text(value: float | str | None, form: str = "") -> str:
    """Return a figure as text for a person; "-" if it was not reported."""
    return "-" if value is None else f"{value:{form}}"


class Diagnostics:
    """Health figures of a slave, received or to be published. False if there are none.

    `raw` has the texts that are sent on the network, including unknown ones from a slave of another version.
    """

    __slots__ = ("raw",)
    FIGURES: ClassVar[dict[str, Figure[Any]]] = {}

    def __init__(self, raw: Mapping[str, str] | None = None) -> None:
        self.raw = dict(raw or {})

    def __bool__(self) -> bool:
        return bool(self.raw)

    def __getitem__(self, name: str) -> Any:
        """Return the value of a figure, None if it was not reported. Raises KeyError for an unknown name."""
        return self.FIGURES[name].read(self)

    def __setitem__(self, name: str, value: Any) -> None:
        """Set a figure by its name. Raises KeyError for an unknown name."""
        self.FIGURES[name].__set__(self, value)

    def __repr__(self) -> str:
        return f"Diagnostics({self.raw})"

    def as_dict(self) -> dict[str, Any]:
        """Return the values of all known figures that were reported, by name."""
        return {name: figure.read(self) for name, figure in self.FIGURES.items() if name in self.raw}

    # The machine and the slave's program
    board = _text("name of the board, or architecture and name of an unknown machine")
    labels = _texts(
        'labels of the machine such as "emulated: ..."; with a label the figures are not those of a board', "; "
    )
    boot_id = _text("identifier of this boot of the kernel: processes that share it share its monotonic clock")
    cores = _integer("", "processors of the machine")
    ram_mib = _number("MiB", 0, "memory of the machine")
    python = _text("version of Python")
    bytecode_compiled = _flag("true if the slave's Python modules had been compiled before the start")
    realtime = _text("real-time settings in effect: scheduling, locked memory, garbage collector, idle processors")
    # The start
    exec_wall_ns = _integer("ns since 1970", "time of the exec of the slave, by the wall clock at the start")
    startup_python_ms = _number("ms", 1, "from exec until the first line of this project ran")
    startup_scenario_ms = _number("ms", 1, "from exec until the scenario was loaded")
    startup_imports_ms = _number("ms", 1, "from exec until all modules of the loop were loaded")
    startup_simulator_ms = _number("ms", 1, "from exec until the simulator was built")
    startup_link_ms = _number("ms", 1, "from exec until the thruster link was open")
    startup_session_ms = _number("ms", 1, "from exec until the network session was open")
    startup_ready_ms = _number("ms", 1, "from exec until the first step of the loop")
    # What the slave uses
    uptime_s = _number("s", 2, "since the slave was executed", is_counter=True)
    cpu_s = _number("s", 4, "processor time of the slave and its children", is_counter=True)
    pss_mib = _number("MiB", 2, "memory of the slave and its children, proportional set size")
    rss_mib = _number("MiB", 2, "resident memory of the slave and its children, shared pages counted in each")
    processes = _integer("", "the slave and its children")
    # The loop
    loop_rate_hz = _number("Hz", 0, "rate of the real-time loop")
    real_time_factor = _number("", 4, "simulated time over real time since the start")
    lateness_p50_us = _number("us", 0, "lateness of the loop since its start, median")
    lateness_p99_us = _number("us", 0, "lateness of the loop since its start, 99 %")
    lateness_p999_us = _number("us", 0, "lateness of the loop since its start, 99.9 %")
    lateness_max_us = _number("us", 0, "lateness of the loop since its start, largest")
    lateness_recent_p50_us = _number("us", 0, "lateness of the loop in the last second, median")
    lateness_recent_p99_us = _number("us", 0, "lateness of the loop in the last second, 99 %")
    lateness_recent_max_us = _number("us", 0, "lateness of the loop in the last second, largest")
    within_2ms = _number("", 5, "share of the steps that were at most 2 ms late")
    behind_ms = _number("ms", 2, "present lateness of the loop's schedule")
    steps_skipped = _counter("steps that were left out because the loop was too late")
    messages_sent = _counter("messages published")
    messages_dropped = _counter(
        "samples and messages dropped before they were published, because the network was blocked"
    )
    contacts = _counter("times that the vehicle touched the seabed or an obstacle")
    run_events = _counter("collisions, capsizes, surfacings and losses of the thruster link")
    run_event_list = Figure(
        "events",
        "",
        "first of these events, one line each: kind, start (ns since 1970), duration (ns), place (m), object touched",
        encode_events,
        decode_events,
    )
    # Commands
    controller = _text('"builtin", "autopilot", or "external" if thrusters are left to other software')
    thrusters_driven = _flag("with an external controller: true if the STM32 executed a command in the last second")
    armed = _flag("true if the vehicle accepts commands")
    thrusters = _integer("", "thrusters of the vehicle")
    commands_received = _counter("commands that arrived")
    commands_taken = _counter("commands that were applied")
    commands_malformed = _counter("commands that could not be decoded, or whose values are out of bounds")
    commands_stale = _counter("commands dropped because they were too old")
    commands_disordered = _counter("commands dropped because a newer one had arrived before")
    commands_superseded = _counter("commands replaced by a newer one before the loop read them")
    commands_refused = _counter("commands of masters without permission, or while another master commanded")
    commands_flooded = _counter("commands dropped because they exceeded the rate that the scenario allows")
    commands_fault = _text("error of the last malformed command")
    commands_unanswered = _counter("commands that the STM32 did not answer")
    deadman_trips = _counter("times that the slave stopped the thrusters because no command arrived in time")
    thrusters_failed = _text("names of thrusters that do not do what they are commanded; the others take over")
    thrusters_unwatched = _text("names of thrusters without telemetry, so that nobody notices their failure")
    watchdog_trips = _counter(
        "times that the STM32 stopped the thrusters because no message of the slave arrived in time"
    )
    # The thruster link
    link_protocol = _text("protocol of the thruster link")
    link_baud = _integer("bit/s", "baud rate of a UART link, from the scenario")
    link_held_baud = _integer("bit/s", "rate to which [link.faults] limits the link; 0: no limit")
    link_port = _text("address of the link")
    link_wire = _text('what carries its bytes: "pty" (a pseudo terminal), "uart", "rs485", "tcp", "udp" or "can"')
    link_losses = _counter("times that the link was lost")
    link_bytes_in = _counter("bytes received from the link", "byte")
    link_bytes_out = _counter("bytes written to the link", "byte")
    link_messages_in = _counter("messages decoded")
    link_messages_out = _counter("messages encoded")
    link_checksum_errors = _counter("frames whose checksum was wrong")
    link_malformed = _counter("frames with a correct checksum and impossible contents")
    link_replaced = _counter("commands replaced by a newer one before they were sent on the wire")
    link_dropped_bytes = _counter("bytes outside frames, or that a full wire did not accept", "byte")
    link_faults_sent = _by_fault(
        "faults that [link.faults] caused in sent data since the link was opened: number of chunks or bytes"
    )
    link_faults_received = _by_fault("the same for received data")
    link_slow = _flag("true if the line carries fewer commands than are to be sent; then the newest are sent")
    link_rate_hz = _number("Hz", 1, "commands a second that the line answers")
    stm32_silent = _flag("true if the link is open but the STM32 does not answer")
    pwm_us = _integers("us", "pulse widths in effect, one for each channel")
    # The autopilot; with our own controller none of these
    autopilot = _text("kind of the flight controller, and the address at which it is reached")
    autopilot_connected = _flag("true if outputs of the flight controller arrive")
    autopilot_frame = _text("frame (motor layout) that assigns its motors to the vehicle's thrusters")
    autopilot_outputs = _integers("us", "its output channels as it sent them, motors and others; 0: no output")
    autopilot_packets = _counter("output packets that were applied")
    autopilot_duplicates = _counter("output packets that arrived a second time, for example after a stall")
    autopilot_malformed = _counter("packets that do not belong to its interface and were dropped")
    autopilot_lost = _counter("output packets missing between two that arrived")
    autopilot_resets = _counter("times that it restarted")
    autopilot_stalls = _counter("times that it stopped answering")
    autopilot_silences = _counter("times that the thrusters were stopped because its outputs stopped")
    autopilot_steps_held = _counter("simulation steps that were left out because it answered too late")
    autopilot_delay_p50_ms = _number("ms", 3, "delay from its outputs to pulse widths at the STM32, median")
    autopilot_delay_p99_ms = _number("ms", 3, "the same, 99 %")
    autopilot_roll_error_deg = _number("deg", 2, "roll that it estimates, minus the true one")
    autopilot_pitch_error_deg = _number("deg", 2, "pitch that it estimates, minus the true one")
    autopilot_yaw_error_deg = _number("deg", 2, "heading that it estimates, minus the true one")
    autopilot_position_error_m = _number("m", 2, "distance of the position that it estimates from the true one")
    # The network
    may_command = _texts("names of the certificates that may command; not reported without [security]")
    may_listen = _texts("names of the certificates that may listen; not reported without [security]")
    commanded_by = _text("identifier of the active master; empty if none")
    commander = _text("name of the active master")
    masters = _texts("masters that are present")
    observers = _integer("", "observers that are present")
    masters_lost = _counter("masters that have left")
    services_answered = _counter("calls of ROS services that were answered")
    services_malformed = _counter("calls whose request could not be decoded")
    services_oversized = _counter("calls that were refused without decoding, because the request was too large")
    services_dropped = _counter("calls that were dropped because too many were waiting")
    pings_dropped = _counter("requests to compare clocks that were not answered, because there were too many")
    clock_offset_ms = _number("ms", 4, "clock of the active master, minus that of the slave")
    clock_uncertainty_ms = _number("ms", 4, "uncertainty of this offset")
    clock_drift_ppm = _number("ppm", 2, "rate of change of this offset")
    clock_steps = _counter("times that this offset jumped")
    # The machine
    temperature_c = _number("degC", 1, "temperature of the processor")
    throttled = _text('"no", or the reason why the processor is slowed down')
    cpu_mhz = _number("MHz", 0, "clock of processor 0")
    load_1min = _number("", 2, "load average of the last minute")
    memory_available_mib = _number("MiB", 0, "memory that is available")
    network_received_bytes = _counter("received by all interfaces since the machine started", "byte")
    network_sent_bytes = _counter("sent by all interfaces since the machine started", "byte")
    services = _text('services beside the slave: "running", or those that do not run')
    # The process that makes pictures; without one none of these
    imaging_pid = _integer("", "id of the imaging process; 0: there is none")
    imaging_restarts = _counter("times that the imaging process was restarted")
    imaging_cpu_s = _number("s", 2, "processor time of the present imaging process")
    imaging_requested = _by_sensor("", ".0f", "pictures that the loop requested", is_counter=True)
    imaging_dropped = _by_sensor(
        "", ".0f", "pictures that were left out because the one before was not finished", is_counter=True
    )
    imaging_took_ms = _by_sensor("ms", ".1f", "how long the last picture took")
