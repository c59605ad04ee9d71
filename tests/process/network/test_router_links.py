"""Links of a router: it cuts links without known declarations, and gives new links large send buffers."""

import socket
from functools import partial
from itertools import pairwise
from pathlib import Path
from unittest.mock import Mock

import pytest
import zenoh

from hil.common.clock import NS_PER_S
from hil.network.opening import listen
from hil.network.roles import open_client_session, open_router_session
from hil.network.session import Session
from hil.network.settings import NEW_SEND_BUFFER, SEND_BUFFER, Network, settings
from hil.network.sockets import network_sockets, pair_of
from hil.network.tokens import router_key
from hil.network.workarounds.blocked_router import NewLinks
from hil.network.workarounds.unknown_router import ATTEMPTS, SETTLED_NS, UnknownRouters
from tests.support.processes import Program, free_port, wait_for


def foreign_router(endpoint: str) -> zenoh.Session:
    """Return a session that is a router to the library, as a slave is, but declares nothing."""
    text = settings("slave", (f"tcp/127.0.0.1:{free_port()}",), (endpoint,), Network("routed", endpoint), None)
    return zenoh.open(zenoh.Config.from_json5(text))


def _is_closed(session: Session, link: tuple[str, str, str]) -> bool:
    return link not in session.links()


def test_a_link_to_an_unknown_router_is_cut_a_few_times() -> None:
    endpoint, reported = f"tcp/127.0.0.1:{free_port()}", list[str]()
    with open_router_session(endpoint) as session, foreign_router(endpoint):
        links, cut_at, now = UnknownRouters(session, reported.append), list[int](), 0
        for _ in range(ATTEMPTS):
            assert wait_for(session.links)
            (link,) = session.links()
            links.check(now)
            while len(reported) == len(cut_at):
                now += NS_PER_S
                links.check(now)
            cut_at.append(now)
            assert wait_for(partial(_is_closed, session, link))
        waits = [later - sooner for sooner, later in pairwise([0, *cut_at])]
        assert waits[0] == SETTLED_NS
        assert all(later >= 2 * sooner for sooner, later in pairwise(waits))
        assert wait_for(session.links)
        for seconds in range(600):
            links.check(now + seconds * NS_PER_S)
        assert len(reported) == ATTEMPTS
        assert session.links(), "then it is left as it is: it may be a router of others"


def test_peers_that_never_reconnect_are_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.network.workarounds.unknown_router.MAX_PEERS", 10)
    session, reported = Mock(), list[str]()
    session.tokens.return_value = []
    links = UnknownRouters(session, reported.append)
    for number in range(100):
        session.links.return_value = [(f"{number:x}", "tcp/127.0.0.1:1", f"tcp/127.0.0.1:{number + 2}")]
        session.routers.return_value = {f"{number:x}"}
        for seconds in (0, 10):
            links.check((number * 20 + seconds) * NS_PER_S)
    assert len(reported) == 100
    assert len(links._attempts) == 10


def test_links_of_slaves_clients_and_joined_routers_are_not_cut() -> None:
    endpoint, further = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    network, reported = Network("routed", endpoint), list[str]()
    with (
        open_router_session(endpoint) as session,
        listen(f"tcp/127.0.0.1:{free_port()}", network),
        open_router_session(further, other_endpoints=(endpoint,)),
        open_client_session(endpoint, network),
    ):
        assert wait_for(lambda: len(session.links()) == 3)
        assert len(session.routers()) == 2
        assert wait_for(lambda: len(session.tokens(router_key("*"))) == 3), "its own too"
        links = UnknownRouters(session, reported.append)
        for seconds in range(600):
            links.check(seconds * NS_PER_S)
        assert not reported


def test_a_new_link_has_a_large_send_buffer_and_later_a_small_one() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router_session(endpoint) as session, open_client_session(endpoint, Network("routed", endpoint)):
        assert wait_for(session.links)
        ((_, ours, theirs),) = session.links()
        pair = pair_of(ours, theirs)

        def send_buffer() -> int:
            sizes = [
                end.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) for each, end in network_sockets() if each == pair
            ]
            return sizes[0]

        most = int(Path("/proc/sys/net/core/wmem_max").read_text())
        assert send_buffer() == 2 * min(most, NEW_SEND_BUFFER), "the kernel takes as much again for itself"
        links = NewLinks(session.links)
        links.check(0)
        links.check(SETTLED_NS)
        assert send_buffer() == 2 * SEND_BUFFER


def test_the_router_command_cuts_and_reports_unknown_links(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Program(tmp_path, "router", "--listen", endpoint) as router:
        router.expect("forwarding between all")
        with foreign_router(endpoint):
            router.expect(r"nothing is known of the peer at port \d+; cutting the link, so that it connects again")
