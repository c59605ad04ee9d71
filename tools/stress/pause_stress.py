"""Test whether every client gets samples again after its slave process was paused.

    python tools/stress/pause_stress.py [--pauses 50] [--clients 10] [--seed 1] [--without-repair]

It pauses a slave (SIGSTOP) for 0.9 to 4 s, resumes it, and waits until each client has received a newer sample. A
client that gets none within 10 s is stuck. `--without-repair` tests the library alone: links that are open and not read
are not closed. Exit code 1 when a client was stuck.
"""

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hil.client.client import VehicleClient  # noqa: E402
from hil.client.liveness import LivenessMonitor  # noqa: E402
from hil.common.children import module_command, package_environment, start_child  # noqa: E402 - from a bare checkout too
from hil.common.errors import NetworkError  # noqa: E402
from hil.common.ports import free_ports  # noqa: E402
from hil.network import roles  # noqa: E402

SHORTEST_S, LONGEST_S = 0.9, 4.0
STUCK_S = 10.0
SCENARIO = """
vehicle = "paper_six"
world = "pool"
[start]
north = 4
east = 4
depth = 2
[slave]
listen = "tcp/127.0.0.1:{port}"
[link]
[master]
goal = [8, 7]
depth = 2
speed = 0.8
time_limit = 40
"""
WITHOUT_REPAIR = (
    "import hil.slave.contacts as c, sys; c.Contacts.close_unread_links = lambda _: None; from hil.cli import main; "
)


def come_back(clients: list[VehicleClient], seconds: float) -> list[VehicleClient]:
    """Return the clients that get no new sample within the time."""
    before = {id(client): client.received["odom"] for client in clients}
    missing, deadline = clients, time.monotonic() + seconds
    while missing and time.monotonic() < deadline:
        time.sleep(0.05)
        missing = [client for client in missing if client.received["odom"] == before[id(client)]]
    return missing


def run(pauses: int, count: int, seed: int, repaired: bool) -> int:
    """Pause the slave `pauses` times; return the number of stuck clients."""
    chance, stuck, port = random.Random(seed), 0, free_ports(1)[0]
    with ExitStack() as stack:
        scenario = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "pause.toml"
        scenario.write_text(SCENARIO.format(port=port), encoding="utf-8")
        command = module_command("hil.cli")
        if not repaired:
            setattr(LivenessMonitor, "_reconnect_stalled", lambda _: None)  # noqa: B010 - which no type checker likes as an assignment
            setattr(roles, "close_unread_links", lambda *_: None)  # noqa: B010 - likewise
            command = [sys.executable, "-c", f"{WITHOUT_REPAIR}sys.exit(main(sys.argv[1:]))"]
        log = stack.enter_context((scenario.parent / "slave.log").open("w", encoding="utf-8"))
        slave = start_child([*command, "slave", str(scenario)], environment=package_environment(), stderr=log)
        stack.callback(slave.wait)
        stack.callback(slave.terminate)

        def connect() -> VehicleClient:
            client = VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1", role="observer", topics=("odom",))
            return stack.enter_context(client)

        clients = [connect() for _ in range(count)]
        if come_back(clients, 60.0):
            output = (scenario.parent / "slave.log").read_text(encoding="utf-8")
            raise NetworkError(f"a client got no sample before the first pause: {output}")
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
    parser.add_argument("--without-repair", action="store_true", help="do not close links that are not read")
    options = parser.parse_args()
    return int(run(options.pauses, options.clients, options.seed, not options.without_repair) > 0)


if __name__ == "__main__":
    sys.exit(main())
