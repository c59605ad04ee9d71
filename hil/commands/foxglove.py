"""`uuv-hil foxglove`: vehicles live in Foxglove: their topics as they are, over a websocket."""

import select
from typing import Any

from hil.commands.parser import new_parser
from hil.config import load_scenario
from hil.errors import ConfigError, MissingExtraError, NetworkError
from hil.stop import StopSignals
from hil.transport.recording_file import Message, schema_of
from hil.transport.settings import Network

EXAMPLES = """\
Then open Foxglove, "open connection", ws://localhost:8765. The messages are those of ROS 2, byte for byte.

examples:
  uuv-hil foxglove --connect tcp/192.168.3.116:7447
  uuv-hil foxglove paper_field --host 0.0.0.0 --port 9000      for other machines: anyone who reaches it can look
"""
POLL_S = 0.02


def main(arguments: list[str]) -> int:
    """Show until told to stop; the exit code."""
    parser = new_parser("foxglove", __doc__, EXAMPLES)
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?")
    parser.add_argument(
        "--connect", metavar="ENDPOINT", action="append", help="a slave or a router, tcp/ADDRESS:PORT [the scenario's]"
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to serve at [%(default)s]")
    parser.add_argument("--port", type=int, default=8765, help="[%(default)s]")
    options = parser.parse_args(arguments)
    scenario = load_scenario(options.scenario) if options.scenario else None
    endpoints = options.connect or ([scenario.slave.listen] if scenario else [])
    if not endpoints:
        raise ConfigError("foxglove: give --connect tcp/ADDRESS:PORT, or a scenario")
    network, security = (scenario.network, scenario.security) if scenario else (Network(), None)
    from hil.transport.recording_tap import Tap, save_processor

    save_processor()
    with (
        StopSignals() as stop_fd,
        LiveView(options.host, options.port) as view,
        Tap(endpoints, network, security) as tap,
    ):
        print(f"ws://{options.host}:{view.port} shows {', '.join(endpoints)}; Ctrl-C ends it", flush=True)
        while not select.select((stop_fd,), (), (), POLL_S)[0]:
            for message in tap.take():
                view.show(message)
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
        try:
            self._server = self._library.start_server(name="uuv-hil", host=host, port=port, context=self._context)
        except (RuntimeError, OSError) as error:
            raise NetworkError(f"cannot serve at {host}:{port}: {error}; choose another with --port") from None
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
        channel.log(message.data, log_time=message.published_ns)


def _library() -> Any:
    try:
        import foxglove
    except ImportError:
        raise MissingExtraError("the live view needs foxglove-sdk: pip install 'uuv-hil[foxglove]'") from None
    return foxglove
