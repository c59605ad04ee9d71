"""How long undeclaring an advanced publisher takes."""

import os
import threading
import time

import zenoh
from zenoh.ext import CacheConfig, MissDetectionConfig, declare_advanced_publisher


def config(mode, key):
    config = zenoh.Config()
    config.insert_json5(f"{mode}/endpoints", '["tcp/127.0.0.1:17448"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    if mode == "connect":
        config.insert_json5("listen/endpoints", "[]")
    return config


called = threading.Event()


def on_matching(_):
    called.set()
    time.sleep(0.2)  # any callback may let another thread run


session = zenoh.open(config("listen", ""))
publisher = declare_advanced_publisher(
    session,
    "a/b",
    cache=CacheConfig(max_samples=1),
    sample_miss_detection=MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5),
)
watched = session.declare_publisher("a/c")
listener = watched.declare_matching_listener(zenoh.handlers.Callback(on_matching, indirect=False))
other = zenoh.open(config("connect", ""))
subscriber = other.declare_subscriber("a/c", lambda _: None)
called.wait()
began = time.monotonic()
publisher.undeclare()
print(f"undeclared after {time.monotonic() - began:.1f} s", flush=True)
os._exit(0)
