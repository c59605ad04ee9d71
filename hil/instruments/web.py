"""A wire of HTTP; each request comes in a thread of its own."""

from collections.abc import Callable
from urllib.parse import parse_qsl, urlsplit

from hil.common.errors import NetworkError
from hil.common.web.plain_server import PlainHandler, PlainHttpServer
from hil.instruments.contract import Response

LARGEST = 1 << 20  # bytes of a request
# method, path, query, body -> answer; None: the device is silent
Serve = Callable[[str, str, dict[str, str], bytes], Response | None]


def serve_web(host: str, port: int, serve: Serve) -> PlainHttpServer:
    """Serve HTTP, until that is stopped; `serve` gets each request. Raises NetworkError if the port is in use."""

    class Handler(PlainHandler):
        """Passes each request on."""

        protocol_version = "HTTP/1.1"  # as Go's server in the devices: clients send many requests over one connection
        wbufsize = 1 << 16  # head and body leave together; a body of its own would wait for the head's acknowledgement

        def do_any(self) -> None:
            """Answer a request as the instrument does; an instrument that is silent closes the connection."""
            if not self.server.is_serving:  # the power that this connection had is gone
                self.close_connection = True
                return
            length = self.headers.get("Content-Length", "0")
            if not length.isdecimal() or int(length) > LARGEST:
                self.send_error(413)
                return
            parts = urlsplit(self.path)
            body = self.rfile.read(int(length))
            response = serve(self.command, parts.path, dict(parse_qsl(parts.query)), body)
            if response is None:
                self.close_connection = True
                return
            self.send_response(response.status)
            self.send_header("Content-Type", response.content_type)
            if response.stream is None:
                self.send_header("Content-Length", str(len(response.body)))
                self.end_headers()
                self.wfile.write(response.body)
                return
            self.close_connection = True  # its end is that of the stream
            self.send_header("Connection", "close")
            self.end_headers()
            for piece in response.stream:
                self.wfile.write(piece)
                self.wfile.flush()

        do_GET = do_PUT = do_POST = do_DELETE = do_PATCH = do_any  # noqa: N815 - http.server's names

    try:
        server = PlainHttpServer("instrument", (host, port), Handler)
    except OSError as error:
        raise NetworkError(f"http:{host}:{port}: {error.strerror}; choose another address") from None
    server.start()
    return server
