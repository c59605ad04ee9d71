"""Services of vehicles for clients of ROS 1."""

import asyncio
from collections.abc import Callable

from hil.common.errors import HilError
from hil.gateways.commanding import LARGEST
from hil.gateways.ros1.messages import Kind, UnreadableError, to_cdr, to_ros1
from hil.gateways.ros1.tcpros import Connection, encode_header, frame, read_frame, require_type

Call = Callable[[str, str, bytes], bytes]
FAILED, DONE = b"\x00", b"\x01"


async def serve_calls(name: str, service: Kind, call: Call, node: str, connection: Connection) -> None:
    """Answer the calls of a connection whose header named this service: one, or several if it is persistent.

    `call` gets name, type and request, CDR, in another thread, and returns the response; it may raise HilError, which
    the client gets. Raises PeerError, and what a closed connection raises.
    """
    header, reader, writer = connection
    require_type(header, name, service.name, service.md5sum)
    halves = {"request_type": f"{service.name}Request", "response_type": f"{service.name}Response"}
    writer.write(encode_header({"callerid": node, "md5sum": service.md5sum, "type": service.name, **halves}))
    await writer.drain()
    if header.get("probe") == "1":  # it asks for the type alone
        return
    while True:
        request = await read_frame(reader, LARGEST, "a request")
        try:
            payload = to_cdr(f"{service.type}_Request", request)
            response = await asyncio.to_thread(call, name, service.type, payload)
            answer = DONE + frame(to_ros1(f"{service.type}_Response", response))
        except HilError as error:
            answer = FAILED + frame(str(error).encode())
        except UnreadableError:
            answer = FAILED + frame(f"the request is none of {service.name}".encode())
        writer.write(answer)
        await writer.drain()
        if header.get("persistent") not in ("1", "true"):
            return
