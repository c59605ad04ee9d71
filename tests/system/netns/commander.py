"""A master that commands fifty times a second and prints its measurements, a JSON object, at the end of its input."""

import json
import sys
import time

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.scenario.config import load_scenario


class Commander(VehicleClient):
    """A client that records the arrival times of samples."""

    arrival_times: list[float]

    def _deliver(self, topic: str, payload: bytes, attachment: bytes) -> None:
        super()._deliver(topic, payload, attachment)
        if topic == "ground_truth":
            self.arrival_times.append(time.monotonic())


def main(scenario: str, endpoint: str) -> None:
    loaded = load_scenario(scenario)
    Commander.arrival_times = []
    client = Commander(
        endpoint,
        loaded.slave.node,
        network=loaded.network,
        security=loaded.security,
        report=lambda text: print(f"{time.monotonic():.4f} {text}", flush=True),
    )
    with client, open(sys.argv[3]) as ending:
        client.wait_for_vehicle(60)
        print(f"{time.monotonic():.4f} commanding", flush=True)
        while not ending.read():
            client.command(VelocityCommand(surge=0.2))
            time.sleep(0.02)
        time.sleep(0.2)
        delays = client.delays.totals_ns()
        values = client.diagnostics()
    figures = {"came": client.arrival_times, "delays_ms": [delay / 1e6 for delay in delays], "diagnostics": values.raw}
    print(json.dumps(figures), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
