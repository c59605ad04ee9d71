"""A wire of HTTP: requests come in threads of the server and are answered in that of the instruments."""

import threading
from collections.abc import Callable
from urllib.parse import parse_qsl, urlsplit

from hil.common.errors import NetworkError
from hil.common.web.plain_server import PlainHandler, PlainHttpServer
from hil.instruments.contract import Response

ANSWER_S = 5.0  # for an answer of the instrument; without power it gives none
LARGEST = 1 << 20  # bytes of a request


class Job:
    """One request, until `answer` is called from the thread of the instruments; None: the device is silent."""

    def __init__(self, method: str, path: str, query: dict[str, str], body: bytes) -> None:
        self.method, self.path, self.query, self.body = method, path, query, body
        self._answered = threading.Event()
        self._response: Response | None = None

    def answer(self, response: Response | None) -> None:
        """Give the answer."""
        self._response = response
        self._answered.set()

    def wait(self) -> Response | None:
        """Return the answer; None if none comes in time."""
        self._answered.wait(ANSWER_S)
        return self._response


class WebWire:
    """Serves HTTP at host and port; `serve` gets each request. Raises NetworkError if the port is in use."""

    def __init__(self, where: tuple[str, int], serve: Callable[[Job], None]) -> None:
        try:
            self._server = PlainHttpServer("instrument", where, _handler(serve))
        except OSError as error:
            name = f"http:{where[0]}:{where[1]}"
            raise NetworkError(f"{name}: {error.strerror}; choose another address") from None
        self._server.start()

    def close(self) -> None:
        """Close the port."""
        self._server.stop()


def _handler(serve: Callable[[Job], None]) -> type[PlainHandler]:
    class Handler(PlainHandler):
        """Passes each request on."""

        def do_any(self) -> None:
            """Answer a request as the instrument does; an instrument that is silent closes the connection."""
            length = self.headers.get("Content-Length", "0")
            if not length.isdecimal() or int(length) > LARGEST:
                self.send_error(413)
                return
            parts = urlsplit(self.path)
            job = Job(self.command, parts.path, dict(parse_qsl(parts.query)), self.rfile.read(int(length)))
            serve(job)
            response = job.wait()
            if response is None:
                self.close_connection = True
                return
            self.send_response(response.status)
            self.send_header("Content-Type", response.content_type)
            self.send_header("Content-Length", str(len(response.body)))
            self.end_headers()
            self.wfile.write(response.body)

        do_GET = do_PUT = do_POST = do_DELETE = do_PATCH = do_any  # noqa: N815 - http.server's names

    return Handler
