"""Print the latency (ms, median and 95 %) of positions at the first viewer; runs on the machine of the viewers.

python -m tests.system.netns.view_latency SLAVE ADDRESS TOKEN VIEWERS SETTLE_S SECONDS
"""

import sys
import time

from hil.client.client import VehicleClient
from hil.common.quantiles import quantile
from tools.costs.view_cost import Clock, Viewers, fly


def main(slave: str, address: str, token: str, viewers: str, settle_s: str, seconds: str) -> None:
    clock = Clock()
    with VehicleClient(slave, "uuv1", topics=("ground_truth", "trace")) as client:
        client.session.subscribe("uuv1", "ground_truth", clock.on_truth, 64)
        assert client.wait_for_vehicle(30.0)
        with Viewers(int(viewers), address, token, clock) as connected_viewers:
            fly(client, float(settle_s))
            first, updates, began = len(connected_viewers.latency_ms), connected_viewers.updates, time.monotonic()
            fly(client, float(seconds))
            late = sorted(connected_viewers.latency_ms[first:])
            rate = (connected_viewers.updates - updates) / (time.monotonic() - began)
    print(f"latency {quantile(late, 0.5):.1f} {quantile(late, 0.95):.1f} ms, {rate:.1f} updates a second", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
