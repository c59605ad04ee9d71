"""The session of the imaging process: its messages pass through that of the slave to permitted receivers."""

import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from hil.commands.keys import add_machine, init
from hil.network.opening import listen
from hil.network.roles import open_master_session, open_router_session
from hil.network.security import Security
from hil.network.session import Session
from hil.network.settings import Network
from hil.ros.topics import TOPICS
from hil.scenario.config import Scenario
from hil.scenario.records import Master, Slave
from hil.slave.imaging.process import join
from tests.support.processes import free_port, wait_for

PICTURE = bytes(3_000_000)  # more than a slave takes from a master


def scenario(endpoint: str, network: Network = Network(), security: Security | None = None) -> Scenario:
    slave = Slave(listen=endpoint)
    return Scenario("paper_six", "pool", Master((1.0, 1.0)), slave=slave, network=network, security=security)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def arrives(imaging: Session, *masters: Session) -> list[set[int]]:
    """Return the sizes of pictures that each of the masters gets."""
    received: list[set[int]] = [set() for _ in masters]
    for sizes, master in zip(received, masters, strict=True):
        master.subscribe("uuv1", "camera/image_raw", lambda _, data, __, sizes=sizes: sizes.add(len(data)), 2)  # type: ignore[misc]
    publisher = imaging.publisher("uuv1", TOPICS["camera/image_raw"])

    pause = iter([0.05, 0.1, 0.2, 0.4, 0.8, *[1.6] * 40])  # a busy machine must get one through before the next comes

    def spoken() -> bool:
        publisher.put(PICTURE, 0)
        time.sleep(next(pause))
        return bool(received[0])

    wait_for(spoken)
    return received


def test_masters_receive_pictures_through_the_slave(stack: ExitStack) -> None:
    loaded = scenario(f"tcp/0.0.0.0:{free_port()}")
    stack.enter_context(listen(loaded.slave.listen, pictures=True))
    master = stack.enter_context(open_master_session(loaded.slave.listen.replace("0.0.0.0", "127.0.0.1")))
    assert arrives(stack.enter_context(join(loaded)), master) == [{len(PICTURE)}]


def test_masters_receive_pictures_through_a_router(stack: ExitStack) -> None:
    router = f"tcp/127.0.0.1:{free_port()}"
    network = Network(mode="routed", router=router)
    loaded = scenario(f"tcp/127.0.0.1:{free_port()}", network)
    stack.enter_context(open_router_session(router, network))
    stack.enter_context(listen(loaded.slave.listen, network))
    master = stack.enter_context(open_master_session(router, network=network))
    assert arrives(stack.enter_context(join(loaded)), master) == [{len(PICTURE)}]


def test_only_permitted_listeners_receive_pictures(stack: ExitStack, tmp_path: Path) -> None:
    init(str(tmp_path))
    for name in ("uuv1", "laptop", "outsider"):
        add_machine(str(tmp_path), name, ["localhost"])

    def security(master: str) -> Security:
        return Security(str(tmp_path / "uuv1"), str(tmp_path / master), ("laptop",))

    loaded = scenario(f"tcp/127.0.0.1:{free_port()}", security=security("laptop"))
    stack.enter_context(listen(loaded.slave.listen, security=loaded.security, pictures=True))
    masters = [
        stack.enter_context(open_master_session(loaded.slave.listen, security=security(name)))
        for name in ("laptop", "outsider")
    ]
    assert arrives(stack.enter_context(join(loaded)), *masters) == [{len(PICTURE)}, set()]


def test_subscribers_are_known_after_an_unread_link(stack: ExitStack) -> None:
    """The library never reads a link whose time limit for opening ends while it calls a slow listener."""
    loaded = scenario(f"tcp/127.0.0.1:{free_port()}")
    opened: list[str] = []

    def be_slow(event: zenoh.LinkEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT and event.link.dst.startswith(loaded.slave.listen):
            opened.append(event.link.dst)
            if len(opened) == 1:
                time.sleep(0.7)  # the limit is 0.3 s

    with listen(loaded.slave.listen, pictures=True):
        imaging = stack.enter_context(join(loaded))
        handler = zenoh.handlers.Callback(be_slow, indirect=False)
        listener = imaging._session.info.declare_link_events_listener(handler)
    stack.enter_context(listen(loaded.slave.listen, pictures=True))
    assert wait_for(lambda: len(opened) > 1), "the first was cut"
    listener.undeclare()  # type: ignore[no-untyped-call]
    master = stack.enter_context(open_master_session(loaded.slave.listen))
    assert arrives(imaging, master) == [{len(PICTURE)}]
