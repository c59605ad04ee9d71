"""A slave's side that answers commands beside pictures of 26 Mbit/s, and a master's side that prints the delays in ms.

Both have one clock. The master's side prints a JSON object, and ends after five seconds.
"""

import json
import sys
import threading
import time

from hil.common.clock import NS_PER_MS, NS_PER_S, now_ns, to_wall_ns
from hil.common.quantiles import quantile
from hil.network.opening import listen
from hil.network.roles import open_master_session
from hil.ros.topics import TOPICS, Topic

NODE = "uuv1"
RATE_HZ, COMMANDS = 50, 250
FRAME = 65536  # bytes
CAMERA = Topic("camera", "sensor_msgs/msg/Image", RATE_HZ, "background")


def stamp(payload: bytes = b"") -> bytes:
    return now_ns().to_bytes(8, "little") + payload


def stamp_of(payload: bytes) -> int:
    return int.from_bytes(payload[:8], "little")


def answer(endpoint: str, camera: bool) -> None:
    """Answer each command with its bytes, until this process is ended; publish pictures meanwhile."""
    with listen(endpoint) as session:
        trace, pictures = (session.publisher(NODE, topic) for topic in (TOPICS["trace"], CAMERA))
        session.subscribe(NODE, "cmd_vel", lambda _, payload, __: trace.put(payload, to_wall_ns(now_ns())), 64)
        while True:
            if camera:
                pictures.put(stamp(bytes(FRAME - 8)), to_wall_ns(now_ns()))
            time.sleep(1 / RATE_HZ)


def ask(endpoint: str) -> dict[str, float]:
    """Return quantiles of round trips and of the age of pictures, after the sessions have connected."""
    round_trips: list[float] = []
    ages: list[float] = []
    began_ns = NS_PER_S * 10**9
    ready = threading.Event()

    def add(to: list[float], payload: bytes) -> None:
        if stamp_of(payload) >= began_ns:
            to.append((now_ns() - stamp_of(payload)) / NS_PER_MS)
        ready.set()

    with open_master_session(endpoint) as session:
        session.subscribe(NODE, "trace", lambda _, payload, __: add(round_trips, payload), 64)
        session.subscribe(NODE, "camera", lambda _, payload, __: add(ages, payload), 64)
        commands = session.publisher(NODE, TOPICS["cmd_vel"])
        while not ready.wait(0.1):
            commands.put(stamp(bytes(56)), to_wall_ns(now_ns()))
        began_ns = now_ns()
        for _ in range(COMMANDS):
            commands.put(stamp(bytes(56)), to_wall_ns(now_ns()))
            time.sleep(1 / RATE_HZ)
        time.sleep(0.5)
    return {
        "answered": len(round_trips) / COMMANDS,
        "frames_per_s": len(ages) * RATE_HZ / COMMANDS,
        "round_trip_p50": quantile(sorted(round_trips), 0.5),
        "round_trip_p95": quantile(sorted(round_trips), 0.95),
        "frame_age_p50": quantile(sorted(ages), 0.5) if ages else 0.0,
    }


if __name__ == "__main__":
    if sys.argv[1] == "ask":
        print(json.dumps(ask(sys.argv[2])), flush=True)
    else:
        answer(sys.argv[2], "camera" in sys.argv)
