"""`uuv-hil view`: show vehicles live in a browser, and steer them."""

import select

from hil.commands.listening import add_fleet, connect_arguments, presence
from hil.commands.view.opening import open_view, scene_content
from hil.commands.view.tls import page_tls
from hil.common.clock import NS_PER_S, now_ns
from hil.common.options import add_serving, new_parser
from hil.common.stop import StopSignals
from hil.view.pace import Pace
from hil.view.sources.live import LiveSource

EXAMPLES = """\
Open the address that it prints in any browser; it holds a token that is new at each start. With the scenario of the
vehicle the view also shows the seabed, the obstacles, the planned path and the vehicle's shape.

examples:
  uuv-hil view                                         a slave on this machine
  uuv-hil view --scenario paper_field                  with the map of its world
  uuv-hil view --connect tcp/192.168.3.116:7447        a slave elsewhere
  uuv-hil view --listen 0.0.0.0:7480                   for browsers of other machines, with the token
  uuv-hil view --listen 0.0.0.0:7480 --cert cert.pem --key key.pem      encrypted
  uuv-hil view --observe                               never command a vehicle
"""


def main(arguments: list[str]) -> int:
    """Show until stopped; return the exit code."""
    parser = new_parser("view", __doc__, EXAMPLES)
    add_fleet(parser)
    add_serving(parser, "127.0.0.1:7480")
    parser.add_argument("--observe", action="store_true", help="never command a vehicle")
    parser.add_argument("--cert", metavar="FILE", default="", help="certificate of the page, which is then encrypted")
    parser.add_argument("--key", metavar="FILE", default="", help="its private key")
    parser.add_argument("--no-browser", action="store_true", help="print the address, but open no browser")
    options = parser.parse_args(arguments)
    scenario, (endpoints, routed, keys) = connect_arguments(options)
    tls = page_tls(options.listen[0], options.cert, options.key, keys)
    with (
        StopSignals() as stop_fd,
        LiveSource(endpoints, observe=options.observe, routed=routed, keys=keys, scenario=scenario) as source,
        open_view(source, scene_content(scenario), options.listen, not options.no_browser, tls=tls) as view,
    ):
        pace = Pace(now_ns())
        reported: list[str] | None = None
        while True:
            wait = max(pace.due_ns - now_ns(), 0) / NS_PER_S
            ready = select.select((stop_fd, source.fileno()), (), (), wait)[0]
            if stop_fd in ready:
                break
            if ready:
                source.clear()
                pace.on_sample(now_ns())
            if pace.draws(now_ns()):
                view.update()
                if (names := [name for name in source.names if source.is_present(name)]) != reported:
                    reported = names
                    print(presence(reported, endpoints), flush=True)
    return 0
