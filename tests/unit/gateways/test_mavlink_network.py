"""The MAVLink vehicle of a network client, and the loop that serves it to ground stations."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast
from unittest.mock import Mock, call, create_autospec

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autonomy.control.controller import VelocityCommand
from hil.client import client as client_module
from hil.client.client import Stamped
from hil.common.clock import NS_PER_MS, NS_PER_S
from hil.common.errors import NetworkError
from hil.gateways.mavlink import gateway, vehicle_port
from hil.gateways.mavlink.gateway import STALL_NS, TICK_NS, Gateway
from hil.gateways.mavlink.parameter_table import ParameterTable
from hil.gateways.mavlink.protocols.signing import SigningKey
from hil.gateways.mavlink.snapshot import NEUTRAL, Echo, ThrusterTest
from hil.gateways.mavlink.vehicle_port import REFRESH_S, TOPICS, NetworkVehicle
from hil.links.contract import Counters
from hil.links.endpoints.sockets import SILENT_NS, Address, Link
from hil.links.mavlink.stream import MavlinkStream
from hil.ros.commands import PoseCommand, encode_pose, encode_thrusts
from hil.ros.diagnostics import Diagnostics
from hil.ros.dvl import AltitudeSample
from hil.ros.frames import encode_wrench
from hil.ros.joints import MotorState, encode_accessories
from hil.scenario.mavlink_records import Mavlink
from sim.sensors.extra_samples import BatterySample, FieldSample, FixSample, RangeSample
from sim.sensors.samples import ImuSample, OdometrySample, PressureSample
from tests.support.clients.mavlink_vehicle import PointVehicle

NOW = 100 * NS_PER_S
WORK = NetworkVehicle._work
HERE, LEVEL = (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0)
BATTERY, FIX = BatterySample(0, 15.0, 2.0, 9.0, 10.0, False), FixSample(0, 45.0, 10.0, 0.0, (1.0, 1.0), True)
SAMPLES: dict[str, Any] = {
    "odom": OdometrySample(0, HERE, LEVEL, (0.0,) * 6), "pressure": PressureSample(0, 121_325.0), "battery": BATTERY,
    "gps": FIX, "altitude": AltitudeSample(0, 8.0), "altimeter": RangeSample(0, 7.0, (0.3, 50.0)), "leak": True,
    "motors": (MotorState(1499.6, 1.0, 2.0),), "imu": ImuSample(0, LEVEL, HERE, HERE),
    "magnetometer": FieldSample(0, HERE),
}  # fmt: skip


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a client with fresh samples, and the services of its vehicle as `read`, `set` and `call`."""
    made = Mock(node="uuv1", session=None, in_doubt=False, contact=Mock(present=True), figures=Diagnostics())
    made.latest = {topic: Stamped(sample, NOW, NOW) for topic, sample in SAMPLES.items()}
    made.diagnostics.return_value, made.unavailable_reason.return_value = made.figures, ""
    made.offers.return_value, made.set.return_value = {"odom", "gps"}, ""
    made.read.return_value = {"gains.surge.p": 4.0, "gains.depth.p": 0.5}
    monkeypatch.setattr(client_module, "now_ns", lambda: NOW)
    monkeypatch.setattr(NetworkVehicle, "_work", lambda _: None)  # the tests call it
    for name, answer in (("read_parameters", made.read), ("set_parameter", made.set), ("call", made.call)):
        monkeypatch.setattr(vehicle_port, name, answer)
    return made


def work(port: Any, rounds: int = 1) -> Any:
    """Do what the thread does, some rounds; return how it waits after each of them."""
    port._ending, port._wake = Mock(is_set=Mock(side_effect=[False] * rounds + [True])), Mock()
    WORK(port)
    return port._wake.mock_calls


def known(client: Any) -> NetworkVehicle:
    """Return the vehicle once its sensors and parameters are known."""
    port = NetworkVehicle(client)
    work(port)
    return port


def test_the_thread_asks_a_vehicle_that_is_there_and_ends_with_the_port(client: Any) -> None:
    lines, ends = list[str](), Mock()
    client.contact.present = False
    with NetworkVehicle(client, lines.append) as port:
        client.watch.assert_called_once_with(*TOPICS)
        assert work(port, 2) == [call.wait(0.1), call.clear()] * 2
        assert (client.read.called, port.snapshot(), lines) == (False, None, [])
        client.contact.present = True
        assert port.snapshot() is None, "its sensors are not known yet"
        assert work(port, 2) == [call.wait(REFRESH_S), call.clear()] * 2
        assert (client.read.call_count, lines) == (2, ["connected: uuv1"])
        assert port.parameters() == {"HIL_G_SURGE_P": 4.0, "PSC_POSZ_P": 0.5}
        port._ending, port._wake, port._thread = ends.ending, ends.wake, ends.thread
    assert ends.mock_calls == [call.ending.set(), call.wake.set(), call.thread.join(5.0)]


def test_a_vehicle_without_services_is_known_by_its_samples_until_it_is_gone(client: Any) -> None:
    client.read.side_effect = NetworkError
    port = known(client)
    assert getattr(port.snapshot(), "sensors", None) == {"odom", "gps"}
    for present in (False, True):  # it may be another one
        client.contact.present = present
        assert port.snapshot() is None


LIMITS: dict[str, tuple[float, str, Any, Any]] = {  # topic -> its limit (s), field, its value, and that without it
    "pressure": (1.0, "pascal", 121_325.0, None), "battery": (3.0, "battery", BATTERY, None),
    "gps": (3.0, "fix", FIX, None), "leak": (3.0, "leak", True, False), "imu": (1.0, "imu", SAMPLES["imu"], None),
    "magnetometer": (1.0, "field", HERE, None), "motors": (1.0, "pulses", (1500,), (1400,)),
    "altimeter": (1.0, "echo", Echo(7.0, 0.3, 50.0), Echo(8.0, 0.05, 200.0)),
}  # fmt: skip


@pytest.mark.parametrize("topic", [*LIMITS, "odom"])
def test_a_sample_counts_until_it_is_old(client: Any, topic: str) -> None:
    limit_s, field, value, without = LIMITS.get(topic, (1.0, "link_silent", False, None))
    port = known(client)
    client.figures.pwm_us = (1400,)
    for age_ns, expected in ((0, value), (limit_s * NS_PER_S, value), (limit_s * NS_PER_S + 1, without)):
        client.latest[topic] = Stamped(SAMPLES[topic], NOW, NOW - round(age_ns))
        assert getattr(port.snapshot(), field, None) == expected, age_ns
    client.latest = {} if topic == "odom" else {"odom": client.latest["odom"]}
    snapshot = port.snapshot()
    bare = snapshot and (snapshot.state.position, snapshot.echo, snapshot.pulses, snapshot.motors, snapshot.leak)
    assert bare == (None if topic == "odom" else (HERE, None, (1400,), (), False))


@pytest.mark.parametrize(
    ("figures", "load", "silent", "disarmed"),
    [({}, 0.0, False, False), ({"cpu_s": 3.0, "uptime_s": 10.0, "armed": True}, 0.3, False, False),
     ({"cpu_s": 0.25, "uptime_s": 0.5, "stm32_silent": True, "armed": False}, 0.25, True, True)],
)  # fmt: skip
def test_figures_of_the_slave_are_shown(
    client: Any, figures: dict[str, Any], load: float, silent: bool, disarmed: bool
) -> None:
    port = known(client)
    for name, value in figures.items():
        client.figures[name] = value
    snapshot = port.snapshot()
    assert snapshot
    assert (snapshot.slave_load, snapshot.link_silent, snapshot.disarmed) == (load, silent, disarmed)
    port.arm()
    work(port)
    calls = [call(None, "/uuv1/arm", "std_srvs/srv/SetBool", {"data": True})]
    assert client.call.mock_calls == calls * disarmed


def test_each_command_goes_to_its_topic(client: Any) -> None:
    port, pose, wrench = known(client), PoseCommand(HERE, 0.5), (0.0, 0.0, 0.0, 0.0, 0.0, 7.0)
    client.figures.thrusters = 3
    for command in (VelocityCommand(1.0), pose, ThrusterTest(1, 5.0), NEUTRAL, wrench):
        port.send(command)
    client.command.assert_called_once_with(VelocityCommand(1.0))
    assert client.send.mock_calls == [
        call("cmd_pose", encode_pose(pose, 0)), call("cmd_thrusters", encode_thrusts([0.0, 5.0, 0.0])),
        call("cmd_thrusters", encode_thrusts([0.0] * 3)), call("cmd_wrench", encode_wrench(0, wrench)),
    ]  # fmt: skip
    client.send.side_effect = NetworkError
    port.send(pose)


def test_an_accessory_is_moved_once_and_again_when_the_vehicle_was_away(client: Any) -> None:
    port = known(client)
    client.send.side_effect = [NetworkError, *[1] * 3]
    for share in (0.5, 0.5, 0.5, 0.0):
        port.set_accessory("lights", share)
    client.contact.present = False
    port.snapshot()
    port.set_accessory("lights", 0.0)
    rows = [encode_accessories(0, {"lights": share}) for share in (0.5, 0.5, 0.0, 0.0)]
    assert client.send.mock_calls == [call("cmd_accessories", row) for row in rows]


def test_why_it_refuses_is_said(client: Any) -> None:
    port = known(client)
    assert port.refusal() == ""
    client.in_doubt = True
    assert "another master" in port.refusal()
    client.unavailable_reason.return_value = "uuv1 is disarmed"
    assert port.refusal() == "uuv1 is disarmed"
    client.figures.controller = "autopilot"
    assert "is flown by" in port.refusal()


def test_a_gain_is_set_by_its_name_and_the_result_is_given_once(client: Any) -> None:
    port = known(client)
    client.set.side_effect = ["", "too large", NetworkError("it is gone")]
    client.read.return_value = {"gains.depth.p": 5.0}
    for _ in range(3):
        port.set_parameter("PSC_POSZ_P", 5.0)
    client.contact.present = False
    work(port)
    assert client.set.mock_calls == [call(None, "uuv1", "gains.depth.p", 5.0)] * 3
    assert port.parameters() == {"PSC_POSZ_P": 5.0}
    reasons = ["", "PSC_POSZ_P: too large", "PSC_POSZ_P: it is gone"]
    assert port.pop_settled() == [("PSC_POSZ_P", reason) for reason in reasons]
    assert port.pop_settled() == []


# --- the loop


def wire(*partners: Address) -> Any:
    """Return an endpoint with these partners, which are local by their addresses."""
    made = create_autospec(Link, instance=True, burst=4000, refused=0)
    made.name = "udpin:test"
    made.receive.return_value, made.partners.return_value, made.descriptors.return_value = [], [*partners], []
    made.is_local.side_effect = lambda address: Link.is_local(made, address)
    return made


NEAR, FAR = ("127.0.0.1", 5000, 0), ("192.0.2.1", 5000, 0)
STICKS = dialect.MAVLink_manual_control_message(1, 1000, 0, 500, 0, 0)
STATION = MavlinkStream(255, 190, Counters())


def serve(*links: Any, **settings: Any) -> tuple[Gateway, Callable[[int], None], list[str]]:
    """Return a gateway on endpoints, what lets it do its work at a time (ns), and its reports."""
    now, lines = [0], list[str]()
    vehicle, table = PointVehicle(), ParameterTable()
    made = Gateway(vehicle, Mavlink(**settings), table, links, None, lines.append, clock=lambda: now[0])

    def poll(at: int) -> None:
        now[0] = at
        made.poll()

    return made, poll, lines


def test_the_vehicle_is_served_fifty_times_a_second_and_what_was_missed_is_not_made_up_for() -> None:
    link, ticks = wire(), []
    _, poll, _ = serve(link)
    for twentieth in (0, 1, 19, 20, 45, 60, 180, 181, 199, 200):
        poll(twentieth * TICK_NS // 20)
        ticks.append(link.tick.call_count)
    assert ticks == [1, 1, 1, 2, 3, 4, 5, 6, 6, 7]


@pytest.mark.parametrize(("gap_ns", "stale"), [(STALL_NS, 0), (STALL_NS + 1, 1)])
def test_what_waited_while_the_loop_stood_still_is_not_executed(gap_ns: int, stale: int) -> None:
    link = wire(NEAR)
    made, poll, _ = serve(link)
    for now in (0, gap_ns, gap_ns + 1):
        link.receive.return_value = [(NEAR, STATION.pack(STICKS))] if now == gap_ns else []
        poll(now)
    joystick = made.core.pilot.joystick
    assert (joystick.is_alive(gap_ns + 1), joystick.stale, made.dispatcher.stale) == (not stale, stale, False)


@pytest.mark.parametrize(("source", "may_far"), [("localhost", False), ("network", True)])
def test_partners_come_and_go_with_their_rights(source: str, may_far: bool) -> None:
    first = wire(NEAR, FAR)
    made, poll, lines = serve(first, wire(NEAR, "/dev/tty"), commands_from=source)
    poll(0)
    rights = [(peer.number, peer.may_command) for peer in made.dispatcher.peers.values()]
    assert rights == [(1, True), (2, may_far), (3, True), (4, may_far)]
    note = "" if may_far else " (can only read)"
    names = ["127.0.0.1:5000", f"192.0.2.1:5000{note}", "127.0.0.1:5000", f"/dev/tty{note}"]
    assert lines == [f"udpin:test: sends to {name}" for name in names]
    assert {sent.args[0] for sent in first.send.mock_calls} == {NEAR, FAR}, "each gets its packets at its own address"
    first.partners.return_value, first.receive.return_value = [FAR], [(FAR, STATION.pack(STICKS))]
    poll(TICK_NS)
    assert (lines[4:], [*made.dispatcher.peers]) == (["disconnected: 127.0.0.1:5000"], [2, 3, 4])
    assert made.core.pilot.joystick.is_alive(TICK_NS) == may_far


def test_the_loop_waits_for_what_is_due_and_its_end_stops_the_vehicle(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    signing, links = SigningKey(str(tmp_path / "key"), given="passphrase"), [wire(), wire()]
    signing.stamps.newest[0, 255, 190] = 7
    links[0].descriptors.return_value, links[1].descriptors.return_value = [20], [21]
    made, _, _ = serve(*links)
    ready, times = iter([[], [21], [], [9]]), iter([0, 0, 5, 5, 50, 50, 60, 60])
    select = Mock(select=Mock(side_effect=lambda *_: (next(ready), [], [])))
    monkeypatch.setattr(gateway, "select", select)
    made._signing, made._clock = signing, lambda: next(times) * NS_PER_MS
    made.core.pilot.arm()
    made.run(9)
    assert select.select.mock_calls == [call([9, 20, 21], (), (), wait) for wait in (0.0, 0.015, 0.0, 0.0)]
    assert [(link.receive.call_count, link.close.call_count) for link in links] == [(3, 1)] * 2
    assert (cast(PointVehicle, made.core.port).commands[-1], made.core.pilot.armed) == (NEUTRAL, False)
    assert (tmp_path / "key.stamps").read_text().endswith("0 255 190 7")


def test_refused_ground_stations_are_reported_at_intervals() -> None:
    _, poll, lines = serve(link := wire())
    for tenth in range(31):
        link.refused += 1
        poll(tenth * SILENT_NS // 10)
    assert len(lines) == 4
    assert "udpin:test: 16 ground stations are served; 10 packets and calls of others were refused" in lines[1]
