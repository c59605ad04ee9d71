"""The services of the standard simulation_interfaces (ros-simulation, 1.x) for the vehicle's own simulation.

The only entity is the vehicle, named after its node. Not supported, as `get_simulator_features` reports: lists of
entities, spawning, loading of worlds, resetting time. A pause stops the vehicle and simulation time; link, STM32 and
controller continue, so commands between two single steps take effect.
"""

from collections.abc import Callable, Mapping
from typing import Any

from hil.common.vectors import Vector3
from hil.network.services import Answer
from hil.ros.encoders import swap_attitude, swap_world
from hil.ros.message import Message, header
from hil.slave.loop import Loop
from sim.rotations import rotate

FRAME = "map"
PACKAGE = "simulation_interfaces/srv/"
# Constants of simulation_interfaces: Result, SimulationState, ResetSimulation, SimulatorFeatures.
UNSUPPORTED, OK, NOT_FOUND, FAILED, ALREADY_THERE = 0, 1, 2, 4, 101
PLAYING, PAUSED = 1, 2
STATES = {0: "stopped", PLAYING: "playing", PAUSED: "paused", 3: "quitting"}
DEFAULT_SCOPE, STATE_SCOPE = 0, 2
FEATURES = {
    "ENTITY_STATE_GETTING": 10, "ENTITY_STATE_SETTING": 11, "SIMULATION_RESET": 20, "SIMULATION_RESET_STATE": 22,
    "SIMULATION_STATE_GETTING": 24,
}  # fmt: skip
# Available if the loop steps the simulation by itself, not in lockstep with an autopilot.
PAUSE_FEATURES = {
    "SIMULATION_STATE_SETTING": 25, "SIMULATION_STATE_PAUSE": 26, "STEP_SIMULATION_SINGLE": 31,
    "STEP_SIMULATION_MULTIPLE": 32,
}  # fmt: skip
MAX_STEPS = 200  # in one call, during which the loop does nothing else; 0.5 s of simulation time by default
LONGEST_NAME = 200  # characters

Result = dict[str, Any]


class SimulationServices:
    """Services for a running `loop` whose vehicle is called `node`; `reset` moves the vehicle back to its start."""

    def __init__(self, loop: Loop, node: str, reset: Callable[[], str], report: Callable[[str], None]) -> None:
        self._loop = loop
        self._node = node
        self._reset = reset
        self._report = report

    def services(self) -> dict[str, tuple[str, Answer]]:
        """Return name, below the node's, of each service, with its type and answer."""
        answers: dict[str, tuple[str, Answer]] = {
            "get_simulator_features": ("GetSimulatorFeatures", self._features),
            "reset_simulation": ("ResetSimulation", self._reset_simulation),
            "get_entity_state": ("GetEntityState", self._state),
            "get_simulation_state": ("GetSimulationState", self._simulation_state),
            "set_simulation_state": ("SetSimulationState", self._set_simulation_state),
            "step_simulation": ("StepSimulation", self._step),
        }
        return {name: (f"{PACKAGE}{kind}", answer) for name, (kind, answer) in answers.items()}

    def _features(self, _: Message) -> Result:
        numbers = [*FEATURES.values(), *([] if self._loop.source.keeps_step else PAUSE_FEATURES.values())]
        about = f"uuv-hil: the simulation of {self._node} alone; at most {MAX_STEPS} steps a call"
        return {"features": {"features": sorted(numbers), "custom_info": about}}

    def _reset_simulation(self, request: Message) -> Result:
        if request["scope"] not in (DEFAULT_SCOPE, STATE_SCOPE):
            return result(UNSUPPORTED, f"only the state can be reset (scope {STATE_SCOPE}): time goes on")
        done = self._reset()
        self._report(f"reset_simulation: {done}")
        return result(OK, "the state was reset; time goes on")

    def _state(self, request: Message) -> Result:
        """Return an EntityState in the world's ENU, without acceleration."""
        if request["entity"] != self._node:
            return result(NOT_FOUND, f"no entity {request['entity'][:LONGEST_NAME]!r}; there is: {self._node}")
        publisher, simulation = self._loop.sample_publisher, self._loop.simulation
        state = simulation.state
        motion = [_xyz(swap_world(_three(rotate(state.quaternion, part)))) for part in (state.nu[:3], state.nu[3:])]
        w, x, y, z = state.quaternion
        orientation = dict(zip("wxyz", swap_attitude((w, x, y, z)), strict=True))
        pose = {"position": _xyz(swap_world(_three(state.position))), "orientation": orientation}
        twist = dict(zip(("linear", "angular"), motion, strict=True))
        head = header(publisher.stamps.stamp(simulation.time_ns), FRAME)
        return {**result(OK), "state": {"header": head, "pose": pose, "twist": twist}}

    def _simulation_state(self, _: Message) -> Result:
        return {**result(OK), "state": {"state": PAUSED if self._loop.paused else PLAYING}}

    def _set_simulation_state(self, request: Message) -> Result:
        wanted, paused = request["state"]["state"], self._loop.paused
        if wanted not in (PLAYING, PAUSED) or self._loop.source.keeps_step:
            why = "an autopilot flies it, in step with it" if self._loop.source.keeps_step else "it plays, or is paused"
            return result(UNSUPPORTED, f"{STATES.get(wanted, wanted)}: {why}; to end it, end uuv-hil slave")
        if (wanted == PAUSED) == paused:
            return result(ALREADY_THERE, f"it is {STATES[wanted]} already")
        self._loop.paused = wanted == PAUSED
        self._report(f"set_simulation_state: {STATES[wanted]}")
        return result(OK)

    def _step(self, request: Message) -> Result:
        steps = request["steps"]
        if not self._loop.paused:
            return result(FAILED, "the simulation is not paused; set_simulation_state pauses it")
        if not 1 <= steps <= MAX_STEPS:
            return result(FAILED, f"{steps} steps: 1 to {MAX_STEPS} at once")
        self._loop.advance(steps)
        return result(OK)


def result(code: int, message: str = "") -> Result:
    """Return a response with a Result."""
    return {"result": {"result": code, "error_message": message}}


def _xyz(vector: Vector3) -> Mapping[str, float]:
    return dict(zip("xyz", vector, strict=True))


def _three(vector: Any) -> Vector3:
    x, y, z = vector
    return x, y, z
