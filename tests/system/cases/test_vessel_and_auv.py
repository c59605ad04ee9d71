"""A vessel above finds an AUV below it by USBL, while both fly their missions, in simulated time."""

from math import dist, sqrt

from hil.cases.simulated import SimulatedVehicle
from hil.common.clock import NS_PER_S, seconds_ns
from hil.master.flight import Flight, prepare
from hil.scenario.config import load_scenario
from hil.scenario.fleet import as_member
from hil.scenario.modem import open_channel, open_usbl
from sim.sensors.samples import ODOMETRY

SCENARIO = load_scenario("vessel_and_auv", {"slave.step": 0.01})


def test_the_vessel_finds_the_auv_by_usbl_on_the_way() -> None:
    """Both reach their goals; fixes arrive, as far away as their covariance says, and GPS has a fix all the time."""
    channel = open_channel(SCENARIO)
    usbl = open_usbl(SCENARIO, channel)
    members = [as_member(SCENARIO, node) for node in ("vessel", "auv")]
    plans = [prepare(member) for member in members]
    pairs = {
        member.slave.node: (SimulatedVehicle(member, plan.world), Flight(member, plan))
        for member, plan in zip(members, plans, strict=True)
    }
    vessel, auv = (pair[0] for pair in pairs.values())
    period_ns, due_ns = seconds_ns(SCENARIO.master.command_period), 0
    track, squares, fixed, ready = {}, [], [], 0
    while not all(flight.reason for _, flight in pairs.values()):
        for vehicle, flight in pairs.values():
            vehicle.step()
            if vehicle.time_ns >= due_ns and ODOMETRY in vehicle.samples and not flight.reason:
                truth = vehicle.simulation.truth()
                vehicle.command(flight.command(vehicle.time_ns / NS_PER_S, vehicle.samples, truth))
        now = vessel.time_ns
        due_ns += period_ns if now >= due_ns else 0
        positions = {node: vehicle.simulation.truth().position for node, (vehicle, _) in pairs.items()}
        track[now] = positions
        usbl.ask(now, positions)
        for fix in usbl.take(now, channel.receive(now), positions)[1]:
            assert (fix.receiver, fix.sender) == ("vessel", "auv")
            place = [a + b for a, b in zip(positions["vessel"], fix.offset, strict=True)]
            error = dist(place, track[fix.sent_ns]["auv"])
            squares.append(error * error / (fix.covariance[0] + fix.covariance[4] + fix.covariance[8]))
            fixed.append(now)
        if now > 5 * NS_PER_S:
            ready += vessel.samples["gps"].fix and not auv.samples["gps"].fix
    for _, flight in pairs.values():
        outcome = flight.outcome(vessel.time_ns / NS_PER_S, 0.0)
        assert outcome.reached, outcome
        assert not outcome.events, outcome
    assert len(fixed) > 0.9 * vessel.time_ns / NS_PER_S / 2.0
    assert 0.5 < sqrt(sum(squares) / len(squares)) < 1.5
    assert ready == sum(1 for time in track if time > 5 * NS_PER_S), "at every step"
