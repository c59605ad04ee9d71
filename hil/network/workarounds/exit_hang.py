"""Symptom: a process with an open session and a callback never ends, not even after an exception or Ctrl-C.

By default the library's Python package starts a thread for each callback, and the interpreter waits for that thread at
exit. A direct callback is called in a thread of the library instead.

Report: eclipse-zenoh/zenoh-python#434, #624. Remove when `test_a_process_with_an_indirect_callback_never_ends` fails.
"""

from collections.abc import Callable
from typing import Any

import zenoh


def direct_callback(call: Callable[[Any], None]) -> "zenoh.handlers.Callback[Any]":
    """Return a handler for a declaration that makes the library call `call` in its own thread, which must not wait."""
    handler: zenoh.handlers.Callback[Any] = zenoh.handlers.Callback(call, indirect=False)
    return handler
