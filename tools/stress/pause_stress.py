"""Test whether every client gets samples again after its slave process was paused.

    python tools/stress/pause_stress.py [--pauses 50] [--clients 10] [--seed 1]

It pauses a slave (SIGSTOP) for 0.9 to 4 s, resumes it, and waits until each client has received a newer sample. A
client that gets none within 10 s is stuck. Exit code 1 when a client was stuck.
"""

import argparse
import os
import random
import signal
import sys
import time
from contextlib import ExitStack
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hil.bench.harness import Bench, await_vehicle  # noqa: E402 - from a bare checkout too
from hil.client.client import VehicleClient  # noqa: E402

SHORTEST_S, LONGEST_S = 0.9, 4.0
STUCK_S = 10.0


def come_back(clients: list[VehicleClient], seconds: float) -> list[VehicleClient]:
    """Return the clients that get no new sample within the time."""
    before = {id(client): client.received["odom"] for client in clients}
    missing, deadline = clients, time.monotonic() + seconds
    while missing and time.monotonic() < deadline:
        time.sleep(0.05)
        missing = [client for client in missing if client.received["odom"] == before[id(client)]]
    return missing


def run(pauses: int, count: int, seed: int) -> int:
    """Pause the slave `pauses` times; return the number of stuck clients."""
    chance, stuck = random.Random(seed), 0
    with ExitStack() as stack:
        bench = stack.enter_context(Bench("paper_field"))
        slave = bench.start_slave()

        def connect() -> VehicleClient:
            return stack.enter_context(bench.client(role="observer", topics=("odom",)))

        clients = [connect() for _ in range(count)]
        for client in clients:
            await_vehicle(client, slave)
        for number in range(1, pauses + 1):
            seconds = chance.uniform(SHORTEST_S, LONGEST_S)
            os.kill(slave.pid, signal.SIGSTOP)
            time.sleep(seconds)
            os.kill(slave.pid, signal.SIGCONT)
            time.sleep(0.2)  # time for messages from before the pause to arrive
            lost = come_back(clients, STUCK_S)
            for client in lost:
                stuck += 1
                contact, links = client.contact, [link[1:] for link in client.session.links()]
                state = f"present {contact.present}, reconnected {contact.reconnections} times, links {links}"
                print(f"pause {number} of {seconds:.3f} s: stuck, {state}", flush=True)
            for client in lost:
                print("and back within a minute: ", not come_back([client], 60.0), flush=True)
            clients = [client for client in clients if client not in lost] + [connect() for _ in lost]
            reconnections = sum(client.contact.reconnections for client in clients)
            if number % 10 == 0 or number == pauses:
                print(
                    f"{number} pauses, {number * count} clients, {stuck} stuck, {reconnections} reconnections",
                    flush=True,
                )
    return stuck


def main() -> int:
    """Run the test with the options; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pauses", type=int, default=50, help="[%(default)s]")
    parser.add_argument("--clients", type=int, default=10, help="at once [%(default)s]")
    parser.add_argument("--seed", type=int, default=1, help="of the lengths [%(default)s]")
    options = parser.parse_args()
    return int(run(options.pauses, options.clients, options.seed) > 0)


if __name__ == "__main__":
    sys.exit(main())
