"""A model of ArduPilot that flies forward, and a scenario for it."""

import threading

from tests.support.autopilots.ardupilot_peer import ArdupilotPeer

SCENARIO = """
vehicle = "bluerov2"
world = "open_water"
controller = "ardupilot"
stm32 = "{stm32}"
master = {{}}
[start]
north = 20
east = 20
depth = 5
[slave]
listen = "tcp/127.0.0.1:{port}"
[autopilot]
address = "udp://127.0.0.1:{udp}"
[sensors.imu]
rate = 400
"""
FORWARD_PWM_US = (1400, 1400, 1600, 1600, 1500, 1500)


class Flyer:
    """The autopilot in a thread: it sends `motors` after each answer, until it is paused."""

    def __init__(self, port: int) -> None:
        self.peer = ArdupilotPeer(port)
        self.peer.socket.settimeout(0.3)
        self.motors = FORWARD_PWM_US
        self.running = True
        self.going = threading.Event()
        self.going.set()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while self.running:
            self.going.wait(0.1)
            if not self.going.is_set():
                continue
            try:
                self.peer.step(*self.motors)
            except TimeoutError:  # the same packet again
                continue

    def close(self) -> None:
        self.running = False
        self._thread.join(10)
        self.peer.close()
