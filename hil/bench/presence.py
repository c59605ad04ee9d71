"""Check that a measured slave is still present, so that a slave that has ended or hangs does not give a good result."""

import time

from hil.bench.harness import Process
from hil.client.client import VehicleClient
from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import NetworkError
from hil.scenario.config import Scenario, build_simulation
from sim.environment.world import load_world
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

PATIENCE_S = 5.0  # permitted silence during a measurement, because of load or a slow network
BACK_S = 2.0  # permitted time until the last answer


def wait_for_silence(client: VehicleClient, slave: Process | None = None, patience: float = PATIENCE_S) -> str:
    """Return why the vehicle counts as lost: ended, or silent for longer than `patience` s; "" if it is present.

    A vehicle is silent if it answers no comparison of clocks, or sends no diagnostics any more.
    """
    if slave and not slave.running:
        return f"the slave {slave.ending}"
    stamped = client.latest.get("diagnostics")
    report_age_s = (now_ns() - stamped.received_ns) / NS_PER_S if stamped else 0.0
    if client.contact.silence_s > patience:
        return f"{client.node} at {client.endpoint} {client.contact.silence}"
    if report_age_s > max(patience, PATIENCE_S):  # diagnostics come once a second, from a thread of the lowest priority
        return f"{client.node} at {client.endpoint} has sent no diagnostics for {report_age_s:.1f} s"
    return ""


def check_present(client: VehicleClient, slave: Process | None = None) -> None:
    """Check that the vehicle is present. Raises NetworkError."""
    reason = wait_for_silence(client, slave)
    if reason:
        raise NetworkError(reason)


def check_end(client: VehicleClient, slave: Process | None = None) -> None:
    """Check that the vehicle is present at the end of a measurement. Raises NetworkError."""
    deadline = time.monotonic() + BACK_S
    while not client.contact.present and time.monotonic() < deadline:
        time.sleep(0.05)
    check_present(client, slave)
    if not client.contact.present:
        raise NetworkError(f"{client.node} at {client.endpoint} is lost: it {client.contact.silence}")


def simulation_of(scenario: Scenario) -> Simulation:
    """Return the simulation that a slave of the scenario would run. Raises HilError where there can be none."""
    vehicle, _ = load_vehicle(scenario.vehicle)
    return build_simulation(scenario, vehicle, load_world(scenario.world))
