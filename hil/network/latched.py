"""Declare topics whose last message late joiners get, compatible with rmw_zenoh (zenoh's advanced publishers).

Loaded for such a topic only.
"""

from typing import Any

import zenoh
from zenoh.ext import (
    CacheConfig,
    HistoryConfig,
    MissDetectionConfig,
    declare_advanced_publisher,
    declare_advanced_subscriber,
)


def declare_publisher(session: zenoh.Session, key: str, **options: Any) -> Any:
    """Return a publisher that keeps its last message for others; `options` are those of any publisher."""
    beat = MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5)
    cache = CacheConfig(max_samples=1)
    return declare_advanced_publisher(
        session, key, cache=cache, sample_miss_detection=beat, publisher_detection=True, **options
    )


def declare_subscriber(session: zenoh.Session, keys: str, channel: Any) -> Any:
    """Return a subscriber that asks such publishers what they said last."""
    history = HistoryConfig(detect_late_publishers=True, max_samples=1)
    return declare_advanced_subscriber(session, keys, channel, history=history)
