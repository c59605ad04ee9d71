"""Symptom: closing a session takes 10 s.

While a latched publisher is undeclared, the library holds the interpreter lock and waits for its own thread, up to
10 s if that thread calls us meanwhile. So first the listeners are undeclared, and running calls get time to end.

Report: docs/upstream/zenoh_undeclare.md. Remove when `test_the_report_of_a_late_undeclaration_is_reproduced` fails.
"""

import time
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import zenoh

CALLS_END_S = 0.05  # within this time the library's calls of our callbacks have ended


def end_listeners(declarations: Iterable[Any]) -> None:
    """Undeclare those of the declarations that are listeners for subscribers."""
    listeners = [each for each in declarations if isinstance(each, zenoh.MatchingListener)]
    for listener in listeners:
        with suppress(zenoh.ZError):  # the session was closed
            listener.undeclare()  # type: ignore[no-untyped-call]  # zenoh leaves it unannotated
    if listeners:
        time.sleep(CALLS_END_S)
