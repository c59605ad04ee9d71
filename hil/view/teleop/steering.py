"""Steer vehicles by sticks through the Python interface, with 20 commands a second. One person steers a vehicle."""

import threading
from collections.abc import Callable

from hil.client.vehicle_handle import Vehicle
from hil.common.clock import now_ns
from hil.common.errors import HilError
from hil.view.teleop.stick import Stick, StickCommand

PERIOD_S = 0.05
HOLD_WITHIN = 0.02  # of full deflection; below it depth and heading are held, if the stick requests it

Report = Callable[[str], None]


class Steering:
    """One vehicle that several persons may steer by their sticks. `close` ends it.

    The first person who holds the dead man's switch steers; the others see why they do not. A vehicle that another
    master commands is not taken over. `report` is called with a line of text at each change.
    """

    def __init__(self, vehicle: Vehicle, report: Report) -> None:
        self.vehicle = vehicle
        self._report = report
        self._sticks: dict[int, Stick] = {}
        self._steers: int | None = None
        self._depth: float | None = None
        self._heading: float | None = None
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self.error = ""
        self._thread = threading.Thread(target=self._run, name=f"steering {vehicle.name}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the vehicle if somebody steers it, and end."""
        self._ending.set()
        self._thread.join()

    def update(self, person: int, message: dict[str, object] | None) -> str:
        """Handle a message of one person's stick, or None when the person has left.

        Return why this person does not steer, or "".
        """
        with self._lock:
            if message is None:
                self._sticks.pop(person, None)
            else:
                self._sticks.setdefault(person, Stick()).update(message, now_ns())
            if self._steers not in (None, person) and message is not None and message.get("held") is True:
                return "another person steers"
            return self.error if self._steers == person or message is None or message.get("held") is True else ""

    def _run(self) -> None:
        while not self._ending.wait(PERIOD_S):
            command = self._choose()
            if command is not None:
                self._drive(command)
        self._let_go()

    def _choose(self) -> StickCommand | None:
        """Return the command of the person who steers. If nobody steers, the first who holds the switch begins to."""
        with self._lock:
            now = now_ns()
            commands = {person: stick.command(now) for person, stick in self._sticks.items()}
            if self._steers is not None and commands.get(self._steers) is None:
                self._let_go()
            if self._steers is None:
                self._steers = next((person for person, command in commands.items() if command), None)
                if self._steers is not None:
                    self.error = ""
                    self._report(f"{self.vehicle.name} is steered by hand")
            return commands.get(self._steers) if self._steers is not None else None

    def _drive(self, command: StickCommand) -> None:
        try:
            if command.mode == "effort":
                self.vehicle.push(x=command.surge, y=command.sway, z=command.heave, n=command.yaw)
                return
            depth, heading = self._held_values(command)
            self.vehicle.drive(
                command.surge, command.sway, 0.0 if depth is not None else command.heave,
                0.0 if heading is not None else command.yaw, depth=depth, heading=heading,
            )  # fmt: skip
        except HilError as error:
            self.error = str(error)

    def _held_values(self, command: StickCommand) -> tuple[float | None, float | None]:
        """Return depth and heading to hold: those at the time when the stick returned to the middle."""
        state = self.vehicle.state
        if not command.hold_depth or abs(command.heave) > HOLD_WITHIN:
            self._depth = None
        elif self._depth is None:
            self._depth = max(state.depth, 0.0)
        if not command.hold_heading or abs(command.yaw) > HOLD_WITHIN:
            self._heading = None
        elif self._heading is None:
            self._heading = state.heading
        return self._depth, self._heading

    def _let_go(self) -> None:
        if self._steers is None:
            return
        self._steers = self._depth = self._heading = None
        try:
            self.vehicle.stop()
            self.vehicle.release()
        except HilError as error:
            self.error = str(error)
        self._report(f"{self.vehicle.name} is not steered by hand any more")
