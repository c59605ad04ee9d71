"""Run a process that only wakes and publishes as often as a slave: the lower limit of a slave's cost.

    python -m hil.bench.floors.bare_slave ENDPOINT STEP_NS MESSAGES_PER_S SECONDS REALTIME

It begins with the first subscriber, and prints its share of a core. Its messages are as frequent (20 Hz) and as large
as those of a vehicle's odometry. Not included: commands, and the thruster link.
"""

import select
import sys
import time
from collections.abc import Callable

import zenoh

from hil.common.clock import LOOP_PRIORITY, NS_PER_S, RateKeeper, now_ns, schedule_fifo, stay_awake
from hil.common.lifeline import die_with_parent
from hil.network.publisher import is_matched, key_of
from hil.network.settings import Network, save_threads, settings
from hil.ros.topics import TOPICS

NODE = "bare"
KEY = key_of(TOPICS["odom"], NODE)
PERIOD_NS = NS_PER_S // 20
PAYLOAD, ATTACHMENT = bytes(724), bytes(33)  # of an Odometry
SETTLE_S = 0.5  # after the first subscriber
PATIENCE_NS = 20 * NS_PER_S


def _loop(put: Callable[[], None], step_ns: int, rate: float, seconds: float) -> None:
    """Wake every step, and send the messages that are due, for `seconds`."""
    begun = send_ns = now_ns()
    schedule, sent = RateKeeper(step_ns, begun), 0
    while schedule.deadline_ns < begun + round(seconds * NS_PER_S):
        select.select((), (), (), schedule.timeout())
        now = schedule.on_wakeup()
        schedule.due(now)
        if now >= send_ns:
            send_ns += PERIOD_NS
            while sent < (now - begun) * rate / NS_PER_S:
                put()
                sent += 1


def _await_listener(publisher: zenoh.Publisher) -> None:
    deadline = now_ns() + PATIENCE_NS
    while not is_matched(publisher):
        if now_ns() > deadline:
            sys.exit("nobody listened")
        time.sleep(0.01)
    time.sleep(SETTLE_S)


def main(arguments: list[str]) -> None:
    """Run the bare slave once; exit with a message when no master connects."""
    die_with_parent()
    endpoint, step_ns, rate, seconds, realtime = arguments
    save_threads(pictures=False)  # as a slave
    if realtime == "1":
        schedule_fifo(LOOP_PRIORITY)
        stay_awake()
    with zenoh.open(zenoh.Config.from_json5(settings("slave", (endpoint,), (), Network(), None))) as session:
        publisher = session.declare_publisher(
            KEY,
            priority=zenoh.Priority.DATA,
            congestion_control=zenoh.CongestionControl.DROP,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        _await_listener(publisher)
        begun, cpu_s = now_ns(), time.process_time()  # psutil's processor time has steps of 10 ms
        _loop(lambda: publisher.put(PAYLOAD, attachment=ATTACHMENT), int(step_ns), float(rate), float(seconds))
        share = (time.process_time() - cpu_s) * NS_PER_S / (now_ns() - begun)
    print(f"share {share:.6f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
