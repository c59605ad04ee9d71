"""Fly a mission: from its items, the vehicle's state and the time to a target; a machine without a clock."""

from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.client.samples import State
from hil.common.clock import NS_PER_S
from hil.gateways.mavlink.flight import mission_items
from hil.gateways.mavlink.flight.guidance import Point, is_reached
from hil.gateways.mavlink.flight.mission_items import Item
from hil.gateways.mavlink.flight.targets import Target, TargetError
from hil.gateways.mavlink.parameter_table import ParameterTable
from hil.gateways.mavlink.snapshot import Origin

IDLE, ACTIVE, PAUSED, COMPLETE = (
    dialect.MISSION_STATE_NOT_STARTED,
    dialect.MISSION_STATE_ACTIVE,
    dialect.MISSION_STATE_PAUSED,
    dialect.MISSION_STATE_COMPLETE,
)


class MissionFlight:
    """The flight over a mission's items. `first` is the first that is flown: 1 where item 0 is home.

    `reached` collects numbers of items, `texts` messages for a person.
    """

    def __init__(
        self, parameters: ParameterTable, origin: Callable[[], Origin | None], home: Callable[[], Point], first: int
    ) -> None:
        self._parameters, self._origin, self._home, self._first = parameters, origin, home, first
        self._items: Sequence[Item] = ()
        self.current = 0
        self.status = int(dialect.MISSION_STATE_NO_MISSION)
        self.reached: list[int] = []
        self.texts: list[tuple[int, str]] = []
        self._speed: float | None = None
        self._arrived_ns: int | None = None  # at the current item
        self._stay: Target | None = None  # where it is once the mission is complete, or paused

    @property
    def total(self) -> int:
        """Number of items."""
        return len(self._items)

    def replace(self, items: Sequence[Item]) -> None:
        """Take a new mission, which begins at its first item."""
        self._items = items
        self.restart()
        self.status = IDLE if len(items) > self._first else int(dialect.MISSION_STATE_NO_MISSION)

    def select(self, index: int) -> bool:
        """Go on with that item; return whether there is one."""
        if not 0 <= index < len(self._items):
            return False
        self.current = max(index, self._first)
        self._arrived_ns = self._stay = None
        if self.status in (COMPLETE, PAUSED):
            self.status = ACTIVE
        return True

    def begin(self) -> str:
        """Begin, go on, or begin again when it was complete; return why that cannot be, "" if it can."""
        if len(self._items) <= self._first:
            return "there is no mission"
        if self.status == COMPLETE:
            self.restart()
        self.status = ACTIVE
        self._arrived_ns = self._stay = None
        return ""

    def step(self, state: State, now: int) -> Target | None:
        """Return where to go; a place to stay at once the mission is complete or paused."""
        while self.status == ACTIVE:
            if self.current >= len(self._items):
                self.status = COMPLETE
                self.texts.append((6, "mission complete"))
            elif target := self._fly(self._items[self.current], state, now):
                return target
        if self._stay is None:
            self._stay = Target(state.position, None, state.heading)
        return self._stay

    def restart(self) -> None:
        """Go back to the first item."""
        self.current = self._first
        self._speed = self._arrived_ns = self._stay = None

    def _fly(self, item: Item, state: State, now: int) -> Target | None:
        """Return the target of an item; None once it is done and the next one is current."""
        command = item.command
        if command in mission_items.WAYPOINTS:
            return self._fly_to(item, state, now)
        if command in (dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH, dialect.MAV_CMD_NAV_LAND):
            north, east, _ = self._home() if command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH else state.position
            return self._approach((north, east, -self._parameters["SURFACE_DEPTH"]), None, 0.0, None, state, now)
        if command == dialect.MAV_CMD_DO_CHANGE_SPEED and 0.0 < item.params[1] <= 5.0:
            self._speed = item.params[1]
        elif command in mission_items.IDLE_COMMANDS:
            self.texts.append((4, f"mission item {self.current}: command {command} is ignored"))
        self._next()
        return None

    def _fly_to(self, item: Item, state: State, now: int) -> Target | None:
        try:
            position = mission_items.position_of(item, self._origin(), self._home()[2])
        except TargetError as error:
            self.status = PAUSED
            self.texts.append((3, f"mission item {self.current}: {error}"))
            return None
        radius = mission_items.radius_of(item, self._parameters["WPNAV_RADIUS"])
        return self._approach(
            position, radius, mission_items.wait_of(item), mission_items.heading_of_item(item), state, now
        )

    def _approach(
        self, position: Point, radius: float | None, wait: float, heading: float | None, state: State, now: int
    ) -> Target | None:
        if self._arrived_ns is None:
            if not is_reached(position, state, radius or self._parameters["WPNAV_RADIUS"]):
                return Target(position, None, heading, 0.0, self._speed)
            self._arrived_ns = now
            self.reached.append(self.current)
        if (now - self._arrived_ns) / NS_PER_S < wait:
            return Target(position, None, heading, 0.0, self._speed)
        self._stay = Target(position, None, state.heading if heading is None else heading, 0.0, self._speed)
        self._next()
        return None

    def _next(self) -> None:
        self.current += 1
        self._arrived_ns = None
