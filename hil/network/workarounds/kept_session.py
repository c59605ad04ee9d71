"""Symptom: a session that is closed while one of its publishers is still referenced is never freed, 30 kB each time.

So each publisher is undeclared before its session is closed.

Report: docs/upstream/zenoh_publisher.md. Remove when `test_the_report_of_a_kept_session_is_reproduced` fails.
"""

import time
from typing import Any

import zenoh

ATTEMPTS, WAIT_S = 20, 0.005  # while another thread is using the publisher


def undeclare(publisher: Any) -> None:
    """Undeclare a publisher, which other threads may be using."""
    for _ in range(ATTEMPTS):
        try:
            publisher.undeclare()
        except zenoh.ZError:  # the session was closed
            return
        except RuntimeError:  # another thread is publishing with it at this moment
            time.sleep(WAIT_S)
        else:
            return
