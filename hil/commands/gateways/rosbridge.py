"""`uuv-hil gateway rosbridge`: serve vehicles to web pages and tools that speak rosbridge."""

from hil.commands.gateways.serving import serve_fleet
from hil.commands.listening import add_fleet, add_take_over
from hil.common.options import add_serving, new_parser
from hil.gateways.commanding import Commanding

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
    import cbor2  # noqa: F401 - missed now, and not when a client asks for it

    from hil.gateways.rosbridge.server import RosbridgeServer

    host, port = options.listen
    with serve_fleet(options) as served, RosbridgeServer(host, port, Commanding(served.fleet)) as server:
        address = f"ws://{host}:{server.port}/?token={server.access.token}"
        print(f"{address} serves {', '.join(served.endpoints)}; Ctrl-C ends it", flush=True)
        served.forward(server.show)
    return 0
