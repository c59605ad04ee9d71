"""ROS 2 services of the vehicle: arm, reset, set_pose, failures of thrusters, and those of hil.slave.ros.simulation.

Each service has a name below the node's, and a small function here or in hil.slave.ros.parameters. It runs in the
loop's thread between two steps. A request that cannot be done is refused with a reason in the response.
"""

from collections.abc import Callable, Mapping
from math import hypot, inf
from typing import Any

from hil.common.clock import NS_PER_S
from hil.common.errors import ConfigError
from hil.network.services import Answer, Server
from hil.ros import dialect, types
from hil.ros import encoders as ros
from hil.ros.commands import MAX_PLACE
from hil.ros.graph import plain_name
from hil.ros.message import Message
from hil.scenario.records import Start
from hil.slave.loop import Loop
from hil.slave.ros.parameters import Parameters
from hil.slave.ros.simulation import FAILED, NOT_FOUND, OK, SimulationServices, result
from sim.environment.collision import starts_inside
from sim.rotations import from_euler, rotate_inverse
from sim.vehicle.failures import Failure

SET_BOOL, TRIGGER = "std_srvs/srv/SetBool", "std_srvs/srv/Trigger"
SET_STATE = "simulation_interfaces/srv/SetEntityState"
DESCRIBE = "type_description_interfaces/srv/GetTypeDescription"
_INVALID_POSE = 101  # of simulation_interfaces
_WORLD_FRAMES = ("", "map", "world")
# Limit of the velocity that set_pose accepts, in m and rad a step: 10 m/s and rad/s at 400 Hz. Beyond a limit, the drag
# of a light hull reverses the velocity within one step and the integration diverges. The first of our vehicles does so
# at 0.05.
_MAX_PATH = 0.025

Report = Callable[[str], None]


def offer_services(server: Server, node: str, loop: Loop, start: Start, report: Report) -> None:
    """Offer all services of the vehicle called `node`; `report` gets a line for each change that a service makes."""
    offered: dict[str, tuple[str, Answer]] = {
        "reset": (TRIGGER, lambda _: _answer(report, "reset", reset(loop, start))),
        "set_pose": (SET_STATE, lambda request: set_pose(loop, node, request, report)),
    }
    if loop.source.can_arm:
        offered["arm"] = (SET_BOOL, lambda request: _arm(loop, request["data"], report))
    thrusters = {plain_name(thruster.name): thruster.name for thruster in loop.simulation.vehicle.thrusters}
    for plain, name in thrusters.items():
        offered[f"thrusters/{plain}/fail"] = (SET_BOOL, _failing(loop, name, report))
    offered["set_entity_state"] = offered["set_pose"]  # the name in simulation_interfaces
    offered |= SimulationServices(loop, node, lambda: reset(loop, start), report).services()
    if not dialect.is_humble():
        offered["get_type_description"] = (DESCRIBE, describe)
    offered |= Parameters(loop, node, thrusters, report).services()
    for name, (type_name, answer) in offered.items():
        server.offer(f"/{node}/{name}", type_name, answer)


def arm(loop: Loop, on: bool) -> str:
    """Arm: let commands drive the thrusters. Disarm: set the thrusters to neutral and ignore commands."""
    loop.source.armed = on
    if not on:
        loop.source.set_neutral()
    return "armed: commands are executed" if on else "disarmed: the thrusters are stopped, commands are ignored"


def _arm(loop: Loop, on: bool, report: Report) -> Mapping[str, Any]:
    if on and loop.driver.arming_refusal:
        report(f"arm: refused: {loop.driver.arming_refusal}")
        return {"success": False, "message": loop.driver.arming_refusal}
    return _answer(report, "arm", arm(loop, on))


def reset(loop: Loop, start: Start) -> str:
    """Move the vehicle to its start, at rest, with sound thrusters. Time, battery and dropped weights do not change."""
    loop.fail(*[Failure(thruster.name, "repaired") for thruster in loop.simulation.vehicle.thrusters])
    loop.set_state((start.north, start.east, start.depth), from_euler(0.0, 0.0, start.heading), (0.0,) * 6)
    return f"at ({start.north:g}, {start.east:g}, {start.depth:g}) m, heading {start.heading:g} rad, at rest"


def fail_thruster(loop: Loop, name: str, failing: bool) -> str:
    """Let a thruster give no thrust, or end all its failures."""
    loop.fail(Failure(name, "off" if failing else "repaired"))
    return f"{name} is {'off' if failing else 'repaired'}"


def set_pose(loop: Loop, node: str, request: Message, report: Report) -> dict[str, Any]:
    """Handle SetEntityState: pose and velocity in the world's ENU; the acceleration is ignored.

    From Lyrical on, the request says whether to set the pose and the velocity.
    """
    state, entity, frame = request["state"], request["entity"], request["state"]["header"]["frame_id"]
    if entity not in ("", node):
        return result(NOT_FOUND, f"no entity {entity!r}; there is: {node}")
    if frame not in _WORLD_FRAMES:
        return result(FAILED, f"frame {frame!r} is not known; leave it empty, for map")
    simulation, present = loop.simulation, loop.simulation.state
    position, quaternion, nu = present.position, present.quaternion, present.nu
    if request.get("set_pose", True):
        position, attitude = ros.swap_world(_xyz(state["pose"]["position"])), _xyz(state["pose"]["orientation"], "wxyz")
        size = hypot(*attitude)
        if not 1e-3 < size < inf:
            return result(_INVALID_POSE, "the orientation is none")
        if not all(abs(x) <= MAX_PLACE for x in position):
            return result(_INVALID_POSE, f"a place is not finite, or more than {MAX_PLACE:g} m away")
        quaternion = ros.swap_attitude([x / size for x in attitude])
        if starts_inside(simulation.vehicle, simulation.world, position, quaternion):
            return result(_INVALID_POSE, f"an obstacle or the seabed of {simulation.world.name} is there")
    if request.get("set_twist", True):
        velocity = [ros.swap_world(_xyz(state["twist"][key])) for key in ("linear", "angular")]
        most = _MAX_PATH * NS_PER_S / loop.schedule.period_ns
        if not all(hypot(*vector) <= most for vector in velocity):
            return result(_INVALID_POSE, f"a velocity is not finite, or more than {most:g} m/s or rad/s")
        nu = tuple([x for vector in velocity for x in rotate_inverse(quaternion, vector)])
    loop.set_state(position, quaternion, nu)
    report("set_pose: at ({:g}, {:g}, {:g}) m NED".format(*position))
    return result(OK)


def describe(request: Message) -> dict[str, Any]:
    """Handle GetTypeDescription, for all types that are known here; the sources are without comments."""
    from hil.ros.types.description import describe_type  # not needed by most runs

    name, wanted = request["type_name"], request["type_hash"]
    try:
        if wanted not in ("", types.type_hash(name)):
            raise ConfigError(f"{name} has the hash {types.type_hash(name)} here, not {wanted}")
        described = describe_type(name)
    except ConfigError as error:
        return {"successful": False, "failure_reason": str(error)}
    parts = [described["type_description"], *described["referenced_type_descriptions"]]
    messages = [part["type_name"] for part in parts if request["include_type_sources"] and "/msg/" in part["type_name"]]
    sources = [
        {"type_name": part, "encoding": "msg", "raw_file_contents": types.definition(part).text} for part in messages
    ]
    return {"successful": True, "type_description": described, "type_sources": sources}


def _failing(loop: Loop, name: str, report: Report) -> Answer:
    return lambda request: _answer(report, "thruster", fail_thruster(loop, name, request["data"]))


def _answer(report: Report, name: str, message: str) -> Mapping[str, Any]:
    report(f"{name}: {message}")
    return {"success": True, "message": message}


def _xyz(fields: Mapping[str, float], names: str = "xyz") -> list[float]:
    return [fields[name] for name in names]
