"""Publishing of a loop on a network that cannot carry all samples."""

import statistics
import time
from collections import Counter

from hil.network.opening import listen
from hil.network.presence import fetch_last, serve_last
from hil.network.roles import open_master_session
from hil.slave.sample_publisher import SamplePublisher
from tests.support.processes import free_port, wait_for
from tools.faults.relay import Relay

BYTES_PER_S = 0.4e6
LASER, IMU = bytes(60_000), bytes(300)


def test_large_messages_delay_neither_the_loop_nor_small_messages() -> None:
    port = free_port()
    received, last, spent_s = Counter[str](), dict[str, bytes](), list[float]()
    with (
        listen(f"tcp/127.0.0.1:{port}") as slave,
        Relay(port, BYTES_PER_S) as relay,
        open_master_session(relay.endpoint) as master,
    ):
        sample_publisher = SamplePublisher(slave, "uuv1", 0)
        serve_last(slave, "uuv1")
        master.subscribe("uuv1", "*", lambda topic, *_: received.update([topic]), depth=64)
        assert wait_for(slave.watch_keys("0/uuv1/**"))

        def is_received() -> bool:
            sample_publisher.publish("imu", IMU)
            sample_publisher.publish("laser", IMU)
            return received["imu"] > 0 < received["laser"]

        assert wait_for(is_received)
        before = sample_publisher.sent
        for step in range(300):
            sample_publisher.publish("imu", IMU)
            if step % 10 == 0:
                began = time.monotonic()
                sample_publisher.publish("laser", LASER)  # 600 kB a second
                spent_s.append(time.monotonic() - began)
            if step == 150:
                fetch_last(master, "uuv1", lambda topic, payload, _: last.update({topic: payload}))
            time.sleep(0.01)
        assert wait_for(lambda: received["laser"] > 2), "as many as it carries"
        assert wait_for(lambda: received["imu"] > 250)
    carried_s = len(LASER) / BYTES_PER_S
    assert statistics.median(spent_s) < 0.2 * carried_s, "who waits for the network waits until it is carried"
    assert sample_publisher.sent - before == 330, "those that were left out are missing in the numbers"
    assert last == {"imu": IMU}, "a large message is not stored for those who come late"
