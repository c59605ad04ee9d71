"""`uuv-hil foxglove`: show vehicles live in Foxglove: their topics as they are, over a websocket."""

import select
from typing import Any

from hil.commands.listening import scenario_and_endpoints
from hil.common.errors import MissingExtraError, NetworkError
from hil.common.options import add_connect, add_settings, new_parser, serving_address
from hil.common.stop import StopSignals
from hil.network.settings import Network
from hil.recording.mcap_file import Message, schema_of
from hil.ros.topics import TOPICS

EXAMPLES = """\
Then open Foxglove, "open connection", ws://localhost:8765. The messages are those of ROS 2, byte for byte.
Its clients only look. Foxglove's library asks for no password and checks no origin: any web page that is open in a
browser on this machine can look too, and with another --listen everybody who reaches the port.

examples:
  uuv-hil foxglove --connect tcp/192.168.3.116:7447
  uuv-hil foxglove --listen 0.0.0.0:9000      for other machines: anyone who reaches it can look
"""
LISTEN = "127.0.0.1:8765"
POLL_S = 0.02


def main(arguments: list[str]) -> int:
    """Show until told to stop; the exit code."""
    parser = new_parser("foxglove", __doc__, EXAMPLES)
    add_connect(parser)
    add_settings(parser)
    parser.add_argument(
        "--listen", metavar="[HOST:]PORT", type=serving_address, default=LISTEN, help="where to serve [%(default)s]"
    )
    options = parser.parse_args(arguments)
    scenario, endpoints = scenario_and_endpoints(options)
    network, security = (scenario.network, scenario.security) if scenario else (Network(), None)
    from hil.recording.tap import Tap, save_processor

    save_processor()
    with (
        StopSignals() as stop_fd,
        LiveView(*options.listen) as view,
        Tap(endpoints, network, security) as tap,
    ):
        print(f"ws://{options.listen[0]}:{view.port} shows {', '.join(endpoints)}; Ctrl-C ends it", flush=True)
        print(f"waiting for a vehicle at {', '.join(endpoints)} (`uuv-hil slave` there)", flush=True)
        nodes: set[str] = set()
        while not select.select((stop_fd,), (), (), POLL_S)[0]:
            for message in tap.take():
                view.show(message)
                node = message.topic.split("/")[1]
                if node not in nodes and message.topic.count("/") > 1:  # /tf and /clock are of no vehicle alone
                    nodes.add(node)
                    print(f"here: {node}", flush=True)
            if text := tap.complaint():
                print(text, flush=True)
    return 0


class LiveView:
    """A websocket server for Foxglove, with a channel a topic. Use as a context.

    Raises MissingExtraError, and NetworkError when the port is taken.
    """

    def __init__(self, host: str, port: int) -> None:
        self._library = _library()
        self._context = self._library.Context()
        self._channels: dict[str, Any] = {}
        self._kept: dict[str, Message] = {}  # by topic the last of a latched topic, for those who come later
        how = {"host": host, "port": port, "context": self._context, "server_listener": self}
        try:
            self._server = self._library.start_server(name="uuv-hil", **how)
        except (RuntimeError, OSError) as error:
            raise NetworkError(f"cannot serve at {host}:{port}: {error}; choose another with --listen") from None
        self.port: int = self._server.port

    def __enter__(self) -> "LiveView":
        return self

    def __exit__(self, *_: object) -> None:
        self._server.stop()

    def show(self, message: Message) -> None:
        """Pass a message on, with the time when it was sent."""
        channel = self._channels.get(message.topic)
        if channel is None:
            encoding, text = schema_of(message.type)
            schema = self._library.Schema(name=message.type, encoding=encoding, data=text) if text else None
            channel = self._channels[message.topic] = self._library.Channel(
                message.topic, schema=schema, message_encoding="cdr", context=self._context
            )
        row = TOPICS.get(message.topic) or TOPICS.get(message.topic.rpartition("/")[2])
        if row and row.qos.latched:
            self._kept[message.topic] = message
        channel.log(message.data, log_time=message.published_ns)

    def on_subscribe(self, _client: Any, channel: Any) -> None:
        """Give a client that comes late what was said last on a latched topic; called by the library's thread."""
        message = self._kept.get(channel.topic)
        if message:
            self._channels[message.topic].log(message.data, log_time=message.published_ns)

    def __getattr__(self, name: str) -> Any:
        """Whatever else the library tells a listener is nothing to us."""
        if not name.startswith("on_"):
            raise AttributeError(name)
        return lambda *_: None


def _library() -> Any:
    try:
        import foxglove
    except ImportError:
        raise MissingExtraError("the live view needs foxglove-sdk: pip install 'uuv-hil[foxglove]'") from None
    return foxglove
