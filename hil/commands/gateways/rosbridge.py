"""`uuv-hil gateway rosbridge`: serve vehicles to web pages and tools that speak rosbridge."""

from contextlib import ExitStack

import hil
from hil.commands.listening import add_fleet, add_take_over, connect_arguments, forward
from hil.common.errors import MissingExtraError
from hil.common.options import add_serving, new_parser
from hil.common.stop import StopSignals
from hil.network.settings import Network

EXAMPLES = """\
Clients are roslibjs in web pages, roslibpy, and other software with rosbridge's protocol (v2): JSON over a websocket,
CBOR if a client requests it. Messages are those of ROS 2. A client that opens the address with its token can command
the vehicles and call their services. Programs without the token can only read; web pages need it to read, too.

examples:
  uuv-hil gateway rosbridge --connect tcp/192.168.3.116:7447
  uuv-hil gateway rosbridge --scenario mine.toml
  uuv-hil gateway rosbridge --listen 0.0.0.0:9090             for other machines: programs that reach it can read
"""
LISTEN = "127.0.0.1:9090"


def main(arguments: list[str]) -> int:
    """Serve until stopped; return the exit code."""
    parser = new_parser("gateway rosbridge", __doc__, EXAMPLES)
    add_fleet(parser)
    add_serving(parser, LISTEN)
    add_take_over(parser)
    options = parser.parse_args(arguments)
    scenario, (endpoints, routed, keys) = connect_arguments(options)
    try:
        import cbor2  # noqa: F401 - missed now, and not when a client asks for it

        from hil.gateways.rosbridge.server import RosbridgeServer
    except ImportError as error:
        raise MissingExtraError(f"rosbridge needs {error.name}: pip install 'uuv-hil[rosbridge]'") from None
    from hil.gateways.commanding import Commanding
    from hil.recording.tap import Tap, save_resources

    save_resources()
    network, security = (scenario.network, scenario.security) if scenario else (Network(), None)
    with StopSignals() as stop_fd, ExitStack() as opened:
        fleet = opened.enter_context(hil.connect(*endpoints, routed=routed, keys=keys, take_over=options.take_over))
        host, port = options.listen
        server = opened.enter_context(RosbridgeServer(host, port, Commanding(fleet)))
        tap = opened.enter_context(Tap(endpoints, network, security))
        address = f"ws://{host}:{server.port}"
        print(f"{address}/?token={server.access.token} serves {', '.join(endpoints)}; Ctrl-C ends it", flush=True)
        forward(tap, server.show, fleet, endpoints, stop_fd)
    return 0
