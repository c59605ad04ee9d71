"""XML-RPC as nodes and the master of ROS 1 use it: calls to others, and answers to theirs.

Every answer is [code, message, value]; a code of 1 is success.
"""

import asyncio
from collections.abc import Callable, Mapping
from inspect import isawaitable
from typing import Any
from xmlrpc import client as xml

import aiohttp
from aiohttp import web

from hil.common.errors import NetworkError

CALL_S = 5.0  # for an answer
LARGEST = 1 << 20  # bytes of a request or an answer
SUCCESS, FAILURE, ERROR = 1, 0, -1

CONTENT_TYPE = "text/xml"

Method = Callable[..., Any]


class RefusedError(Exception):
    """A method of ours cannot do what was asked for; the reason is answered."""


async def call(session: aiohttp.ClientSession, uri: str, method: str, *arguments: Any) -> Any:
    """Call a method of a node or the master; return the value of its answer. Raises NetworkError."""
    body = xml.dumps(arguments, method, allow_none=False)
    timeout = aiohttp.ClientTimeout(total=CALL_S)
    try:
        async with session.post(
            uri, data=body.encode(), headers={"Content-Type": CONTENT_TYPE}, timeout=timeout
        ) as response:
            reply: Any = xml.loads(await _read(response.content))[0]
        code, message, value = reply[0]
    except (aiohttp.ClientError, asyncio.TimeoutError, OSError) as error:
        raise NetworkError(f"{uri} does not answer: {error or type(error).__name__}") from None
    except Exception as error:  # noqa: BLE001 - the parsers raise many kinds; whatever answers, it is no node of ROS
        raise NetworkError(f"{uri} gives no answer of ROS 1 to {method}: {str(error)[:200]}") from None
    if code != SUCCESS:
        raise NetworkError(f"{uri} refuses {method}: {str(message)[:200]}")
    return value


async def _read(content: aiohttp.StreamReader) -> bytes:
    data = bytearray()
    async for piece in content.iter_chunked(1 << 16):
        data += piece
        if len(data) > LARGEST:
            raise ValueError(f"more than {LARGEST} bytes")
    return bytes(data)


async def answer(request: web.Request, methods: Mapping[str, Method]) -> web.Response:
    """Answer a request by the method it names. An invalid request is answered with an error; nothing is raised."""
    if request.content_type != CONTENT_TYPE:  # a page in a browser cannot send this type without being asked first
        raise web.HTTPUnsupportedMediaType(text=f"XML-RPC has the content type {CONTENT_TYPE}\n")
    try:
        body = await asyncio.wait_for(request.read(), CALL_S)
    except asyncio.TimeoutError:
        raise web.HTTPRequestTimeout from None
    return web.Response(body=await _answer(body, methods), content_type=CONTENT_TYPE)


async def _answer(body: bytes, methods: Mapping[str, Method]) -> bytes:
    try:
        arguments, name = xml.loads(body)
    except Exception:  # noqa: BLE001 - bytes of others; the parser raises many kinds
        return xml.dumps(xml.Fault(1, "this is no request of XML-RPC")).encode()
    return xml.dumps((await _call(name, arguments, methods),), methodresponse=True).encode()


async def _call(name: Any, arguments: tuple[Any, ...], methods: Mapping[str, Method]) -> list[Any]:
    method = methods.get(name)
    if method is None:
        return [ERROR, f"no method {str(name)[:60]!r}; there are: {', '.join(sorted(methods))}", 0]
    try:
        value = method(*arguments)
        return [SUCCESS, "", await value if isawaitable(value) else value]
    except TypeError:
        return [ERROR, f"{name} does not take these arguments", 0]
    except RefusedError as error:
        return [FAILURE, str(error), 0]
