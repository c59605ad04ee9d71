"""Find all vehicles that answer at some endpoints."""

import atexit
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Literal

from hil.client.vehicle_handle import Vehicle
from hil.common.errors import NetworkError
from hil.common.schema import nearest
from hil.network.presence import watch_presence
from hil.network.roles import open_master_session
from hil.network.security import Security
from hil.network.session import Session
from hil.network.settings import Network
from hil.network.tokens import Presence

How = tuple[Literal["master", "observer"], int, Network, Security | None]  # part, rank, and a client's settings


def connect(*endpoints: str, take_over: bool, observe: bool, routed: bool, keys: str, wait: float) -> "Fleet":
    """Connect to vehicles: see `hil.connect`."""
    if not endpoints:
        raise NetworkError('connect to whom? Give an endpoint, "tcp/HOST:PORT", or "lan"')
    security = Security(slave="", master=keys, may_command=()) if keys else None
    network = Network(mode="routed", router=endpoints[0]) if routed else Network()
    session = open_master_session(*endpoints, network=network, security=security)
    how: How = ("observer" if observe else "master", int(take_over), network, security)
    return Fleet(session, endpoints, how, wait)


class Fleet:
    """The vehicles of one session, by name: fleet["uuv1"]. Use as a context manager, with `with` or `async with`.

    `endpoints`, `network` and `security` are its connection settings. The end of the context or of the program stops
    the vehicles that were commanded.
    """

    def __init__(
        self,
        session: Session,
        endpoints: tuple[str, ...],
        how: How,
        wait: float,
    ) -> None:
        self._session = session
        self.endpoints = endpoints
        self._how = how
        self.network, self.security = how[2:]
        self._wait = wait
        self._present_slaves: dict[str, set[str]] = {}  # vehicle name -> idents of its slaves that are present
        self._known: dict[str, Vehicle] = {}
        self._changed = threading.Condition()
        self._closed = False
        watch_presence(session, "*", self._on_presence)
        session.supervisor.watch_presence(lambda: bool(self._known or self.names))
        atexit.register(self.close)

    def __enter__(self) -> "Fleet":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __aenter__(self) -> "Fleet":
        return self

    async def __aexit__(self, *_: object) -> None:
        import asyncio

        await asyncio.to_thread(self.close)

    def __repr__(self) -> str:
        return f"<fleet at {self._session.name}: {', '.join(self.names) or 'nobody there'}>"

    @property
    def names(self) -> list[str]:
        """Names of the vehicles that are present, sorted."""
        with self._changed:
            return sorted(name for name, idents in self._present_slaves.items() if idents)

    @property
    def vehicles(self) -> dict[str, Vehicle]:
        """Vehicles that are present, by name; waits for the first one. Raises NetworkError if none appears."""
        with self._changed:
            if not self._changed.wait_for(lambda: self.names, self._wait):
                raise NetworkError(f"no vehicle answered within {self._wait:g} s: {self._why_not()}")
        return {name: self[name] for name in self.names}

    def __iter__(self) -> Iterator[Vehicle]:
        return iter(self.vehicles.values())

    def __getitem__(self, name: str) -> Vehicle:
        """Return the vehicle of that name; wait for it. Raises NetworkError if it does not appear."""
        return self.wait_for(name, seconds=self._wait)[0]

    def wait_for(self, *names: str, seconds: float = 30.0) -> list[Vehicle]:
        """Return these vehicles once each is present and has sent its state. Raises NetworkError after `seconds`."""
        deadline = time.monotonic() + seconds
        with self._changed:
            if self._closed:
                raise NetworkError("the connection was closed; connect again")
            here = self._changed.wait_for(lambda: set(names) <= set(self.names), max(0.0, deadline - time.monotonic()))
            if not here:
                raise NetworkError(self._missing(next(name for name in names if name not in self.names), seconds))
            vehicles = [self._handle(name) for name in names]
        for vehicle in vehicles:
            while not (vehicle.present and "odom" in vehicle.client.latest and vehicle.diagnostics):
                if time.monotonic() > deadline:
                    rights = ": its may_listen does not name this machine" if self.security else ""
                    raise NetworkError(f"{vehicle.name} is connected, but sends no samples{rights}")
                time.sleep(0.005)
        return vehicles

    async def find(self, *names: str, seconds: float = 30.0) -> list[Vehicle]:
        """Wait as `wait_for` does, for asyncio."""
        import asyncio

        return await asyncio.to_thread(lambda: self.wait_for(*names, seconds=seconds))

    def stop(self) -> None:
        """Stop every vehicle that was commanded; vehicles out of reach stop by themselves."""
        for vehicle in list(self._known.values()):
            if vehicle.client.has_commanded:
                with suppress(NetworkError):
                    vehicle.stop()

    def close(self) -> None:
        """Stop the vehicles and disconnect. May be called twice."""
        with self._changed:
            if self._closed:
                return
            self._closed = True
        atexit.unregister(self.close)
        for vehicle in list(self._known.values()):
            vehicle.close()
        self._session.close()

    def _on_presence(self, presence: Presence, alive: bool) -> None:
        if presence.role != "slave":
            return
        with self._changed:
            idents = self._present_slaves.setdefault(presence.node, set())
            (idents.add if alive else idents.discard)(presence.ident)
            self._changed.notify_all()

    def _handle(self, name: str) -> Vehicle:
        if name not in self._known:
            self._known[name] = Vehicle(self._session, name, *self._how)
        return self._known[name]

    def _missing(self, name: str, seconds: float) -> str:
        there = self.names
        if there:
            return f"no vehicle {name!r} came within {seconds:g} s; there are: {', '.join(there)}{nearest(name, there)}"
        return f"no vehicle {name!r} came within {seconds:g} s: {self._why_not()}"

    def _why_not(self) -> str:
        from hil.network.diagnosis import why_not  # needed only for an error message

        reasons, routed = [], self._how[2].mode == "routed"
        for endpoint in self.endpoints:
            folder = self.security.folder("master") if self.security else ""
            fault = why_not(endpoint, folder, routed, self._session)
            reasons.append(f"{endpoint}: {fault.text}" if fault else f"{endpoint} answers, but no vehicle does")
        return "; ".join(reasons)
