"""A cable between two network namespaces that loses and delays packets: `bad_wire.py SPACE SPACE LOSS JITTER_S`.

Not every kernel has netem. Two tun devices, one in each namespace, with this process between them;
packets stay in order, as on Wi-Fi, whose acknowledgements work on blocks.
"""

import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import sys
import time

TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
BASE_S = 0.005


def open_tun(space: str, number: int) -> int:
    """Return the packets of a device with the address 10.79.0.`number` in a namespace."""
    descriptor = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    name = f"bad{os.getpid() % 100000}n{number}"
    fcntl.ioctl(descriptor, TUNSETIFF, struct.pack("16sH", name.encode(), IFF_TUN | IFF_NO_PI))
    subprocess.run(["ip", "link", "set", name, "netns", space], check=True)
    for action in (f"address add 10.79.0.{number}/24 dev {name}", f"link set {name} mtu 1500 up"):
        subprocess.run(["ip", "-n", space, *action.split()], check=True)
    return descriptor


def main(spaces: list[str], loss: float, jitter_s: float) -> None:
    ends = [open_tun(space, number) for number, space in enumerate(spaces, 1)]
    generator = random.Random(1)
    waiting: list[tuple[float, int, int, bytes]] = []
    latest = [0.0, 0.0]
    count = 0
    print("carrying", flush=True)
    while True:
        pause = max(waiting[0][0] - time.monotonic(), 0.0) if waiting else 1.0
        for descriptor in select.select(ends, (), (), pause)[0]:
            side = ends.index(descriptor)
            packet = os.read(descriptor, 65536)
            if generator.random() < loss:
                continue
            latest[side] = max(latest[side], time.monotonic() + BASE_S + generator.uniform(0.0, jitter_s))
            count += 1
            heapq.heappush(waiting, (latest[side], count, ends[1 - side], packet))
        while waiting and waiting[0][0] <= time.monotonic():
            os.write(waiting[0][2], heapq.heappop(waiting)[3])


if __name__ == "__main__":
    main(sys.argv[1:3], float(sys.argv[3]), float(sys.argv[4]))
