"""The link test against a model of ArduPilot: what it counts, and that the thrusters stay neutral meanwhile."""

import threading
from pathlib import Path

from hil.autopilots.link_test import line_rate, measure_link
from hil.common.ports import free_ports
from hil.scenario.config import load_scenario
from tests.process.autopilots.test_ardupilot import SCENARIO
from tests.support.autopilots.ardupilot_peer import ArdupilotPeer


def test_it_counts_sent_states_and_received_outputs(tmp_path: Path) -> None:
    port = free_ports(1)[0]
    path = tmp_path / "link.toml"
    path.write_text(SCENARIO.format(port=port, autopilot="", sensors=""))
    peer = ArdupilotPeer(port)
    states: list[float] = []
    stop = threading.Event()

    def fly() -> None:
        while not stop.is_set():
            try:
                states.append(peer.step(1900, 1900, 1900, 1900, 1900, 1900)["position"][0])
            except TimeoutError:  # nobody listens yet, or any more: the same packet again, as ArduPilot does
                continue

    peer.socket.settimeout(0.3)
    thread = threading.Thread(target=fly, daemon=True)
    thread.start()
    try:
        measurement = measure_link(load_scenario(str(path)), 2.0, print)
    finally:
        stop.set()
        thread.join(30)
        peer.close()
    assert measurement.states == 800
    assert abs(measurement.outputs - 800) <= 2
    assert (measurement.lost, measurement.malformed) == (0, 0)
    trip = measurement.round_trip
    assert 0 < trip.quantile(0.5) <= trip.quantile(0.99) <= trip.maximum
    assert measurement.took_s > 0.0
    assert abs(states[-1] - 20.0) < 0.1  # it stays where it is, whatever the outputs say


def test_the_message_rate_that_a_serial_line_can_carry_is_computed(tmp_path: Path) -> None:
    path = tmp_path / "link.toml"
    text = SCENARIO.format(port=1, autopilot="", sensors="").replace('controller = "ardupilot"', 'controller = "px4"')
    path.write_text(text.replace('address = "udp://127.0.0.1:1"', 'address = "/dev/ttyACM0"\nbaud = 115200'))
    assert 100 < line_rate(load_scenario(str(path))) < 160  # as is known of boards at this speed
