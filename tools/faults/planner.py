"""The master of the campaign: it commands all thrusters ahead or astern 20 times a second, or is silent.

    python -m tools.faults.planner ENDPOINT,ENDPOINT DESCRIPTOR [NODE] [SECURITY-SCENARIO]

Reads words from the descriptor, one a line: ahead, astern, silent, ask (prints a line of figures of the vehicle).
It commands the thrust of each thruster, so that the STM32's outputs show which planner's command was executed.
"""

import json
import os
import select
import sys
from contextlib import nullcontext, suppress

from hil.client.client import VehicleClient
from hil.common.errors import NetworkError
from hil.common.lifeline import die_with_parent
from hil.network.roles import open_master_session
from hil.ros.commands import encode_thrusts
from hil.scenario.config import load_scenario

PERIOD_S = 0.05
THRUST_N = 3.0
THRUSTERS = 6
FIGURES = ("steps_skipped", "lateness_p999_us", "commands_stale", "commands_refused", "commands_malformed")


def main(endpoint: str, descriptor: int, node: str = "uuv1", scenario: str = "") -> None:
    """Command until the descriptor is closed."""
    die_with_parent()
    security = load_scenario(scenario).security if scenario else None
    endpoints = endpoint.split(",")
    with (
        open_master_session(*endpoints) if endpoints[1:] else nullcontext(endpoint) as session,
        VehicleClient(session, node, security=security, topics=("ground_truth",)) as client,
    ):
        client.wait_for_vehicle(60.0)
        print("there", flush=True)
        direction, text = "silent", ""
        while True:
            if select.select([descriptor], (), (), PERIOD_S)[0]:
                data = os.read(descriptor, 4096).decode()
                if not data:
                    return
                *words, text = (text + data).split("\n")
                if "ask" in words:
                    _report_state(client)
                direction = next((word for word in reversed(words) if word != "ask"), direction)
            if direction != "silent":
                with suppress(NetworkError):  # two slaves of one name
                    _command(client, direction)


def _command(client: VehicleClient, direction: str) -> None:
    thrust = THRUST_N if direction == "ahead" else -THRUST_N
    client.send("cmd_thrusters", encode_thrusts([thrust] * THRUSTERS))


def _report_state(client: VehicleClient) -> None:
    """Report the slave's figures, and whether the Python interface says that the vehicle is present."""
    try:
        client.get("ground_truth")
        problem = ""
    except NetworkError as error:
        problem = str(error)
    figures = client.diagnostics()
    known = {name: getattr(figures, name) for name in FIGURES}
    print("figures", json.dumps({**known, "present": client.contact.present, "problem": problem}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), *sys.argv[3:])
