"""`uuv-hil bench echo`: echo packets beside a slave, for the network's share in `uuv-hil bench delay`."""

from hil.bench.floors.network import serve
from hil.commands.bench.options import benchmark
from hil.common.options import host, new_parser
from hil.common.stop import StopSignals

EXAMPLES = """\
It prints the value for `uuv-hil bench delay --echo`, and ends with Ctrl-C. It returns every packet to its sender,
without authentication: run it only while you measure.

examples:
  uuv-hil bench echo --listen 192.168.3.116
"""


@benchmark
def main(arguments: list[str]) -> int:
    """Echo packets until a signal to stop. Raises NetworkError."""
    parser = new_parser("bench echo", __doc__, EXAMPLES)
    parser.add_argument(
        "--listen",
        metavar="ADDRESS",
        type=host,
        default="127.0.0.1",
        help="address of this machine to listen on [%(default)s]",
    )
    options = parser.parse_args(arguments)
    with StopSignals() as stop_fd:
        serve(options.listen, stop_fd)
    return 0
