"""What a session keeps whose publisher is declared at `close`."""

import ctypes

import zenoh


def private_kib():
    ctypes.CDLL(None).malloc_trim(0)
    with open("/proc/self/smaps_rollup") as file:
        return sum(int(line.split()[1]) for line in file if line.startswith("Private_"))


def once(undeclares):
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    publisher = session.declare_publisher("a/b")
    if undeclares:
        publisher.undeclare()
    session.close()


for undeclares in (True, False):
    for _ in range(100):
        once(undeclares)
    before = private_kib()
    for _ in range(200):
        once(undeclares)
    print(f"undeclared: {undeclares}, {(private_kib() - before) / 200:.1f} kB a session")
