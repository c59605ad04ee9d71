"""Declare topics whose last message goes to late joiners, compatible with rmw_zenoh (zenoh's advanced publishers).

Loaded only for latched topics.
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
    """Return a publisher that stores its last message for late joiners; `options` as for any zenoh publisher."""
    beat = MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5)
    cache = CacheConfig(max_samples=1)
    return declare_advanced_publisher(
        session, key, cache=cache, sample_miss_detection=beat, publisher_detection=True, **options
    )


def declare_subscriber(session: zenoh.Session, keys: str, channel: Any) -> Any:
    """Return a subscriber that first gets the last message of each latched publisher."""
    history = HistoryConfig(detect_late_publishers=True, max_samples=1)
    return declare_advanced_subscriber(session, keys, channel, history=history)
