"""A link that is opened and never read: `zenoh_pause.py 0.6`, and 0 to compare."""

import subprocess
import sys
import time

import zenoh

PORT = 17447


def config(listens):
    links = f'["tcp/127.0.0.1:{PORT}?prio=1-3", "tcp/127.0.0.1:{PORT + 1}?prio=4-7"]'
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", links if listens else "[]")
    config.insert_json5("connect/endpoints", "[]" if listens else links)
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/unicast/max_links", "2")
    config.insert_json5("transport/unicast/open_timeout", "300")
    return config


if sys.argv[1] == "publish":
    session = zenoh.open(config(True))
    urgent = session.declare_publisher("urgent", priority=zenoh.Priority.REAL_TIME)
    data = session.declare_publisher("data", priority=zenoh.Priority.DATA)
    for _ in range(3000):  # a minute
        urgent.put(bytes(100))
        data.put(bytes(1000))
        time.sleep(0.02)
    sys.exit()

seconds, slow = float(sys.argv[1]), []


def on_link(event):
    if event.kind == zenoh.SampleKind.PUT and str(PORT + 1) in event.link.dst and not slow:
        slow.append(event.link.dst)
        time.sleep(seconds)


count = {"urgent": 0, "data": 0}


def on_sample(sample):
    count[str(sample.key_expr)] += 1


session = zenoh.open(config(False))
links = session.info.declare_link_events_listener(zenoh.handlers.Callback(on_link, indirect=False))
subscribers = [session.declare_subscriber(key, zenoh.handlers.Callback(on_sample, indirect=False)) for key in count]
publisher = subprocess.Popen([sys.executable, __file__, "publish"])
while count["urgent"] < 300:
    time.sleep(1)
    print(count, [link.dst for link in session.info.links()], flush=True)
publisher.kill()
session.close()
