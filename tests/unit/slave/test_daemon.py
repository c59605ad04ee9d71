"""A slave from its start to its end in this process, on a network that stores what it gets."""

import gc
import os
import pickle
import re
import threading
from collections import defaultdict
from contextlib import nullcontext
from math import pi, sin
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from hil.common.clock import NS_PER_MS, now_ns, to_wall_ns
from hil.common.errors import ConfigError, DeviceError
from hil.ros import encoders as ros
from hil.ros import message
from hil.ros.diagnostics import Diagnostics
from hil.ros.graph import SUBSCRIPTIONS, Node, read_token
from hil.ros.joints import encode_accessories
from hil.ros.topics import COMMANDS, DESCRIPTIONS, TOPICS
from hil.scenario.config import load_scenario
from hil.slave import daemon
from hil.slave.ros.describe import MAKERS
from tests.support.clients.imaging_slave import SENSORS
from tests.support.links.link_contract import PATIENCE_S, nothing_leaks
from tests.support.processes import write_scenario

ORIGIN = {"x": 0.0, "y": 0.0, "z": 0.0}
TETHER = '[tether]\nlength = "12 m"\nanchor = [0.0, 0.0, 0.0]\nsegments = 6\n'
AWAITED = {"diagnostics", "trace", "motors", "accessories", "tether", *DESCRIPTIONS}  # then it is stopped
ELSEWHERE = re.compile("autopilot|startup|thrusters_d|link_faults|may_|clock_|temper|throttled|cpu_mhz|services$")


class Network:
    """The session of a slave: `sent` are its messages by topic, `used` what it calls or starts, in this order."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.sent, self.used, self.stop = defaultdict[str, list[bytes]](list), list[Any](), os.eventfd(0)
        self.listening = MagicMock(notes=["it listens"], close=lambda: self.used.append("closed"))
        session = self.session = self.listening.session.return_value
        session.zid, session.publisher.side_effect, session.subscribe.side_effect = "1", self._publisher, self._command
        session.receive.return_value.lost, session.watch_tokens.side_effect = 3, self._subscribe_to_descriptions
        imaging = "slave.imaging.sensors.Imaging"
        for place in ("slave.router_watch.watch_router", "network.responder.answer_searches", f"{imaging}.start",
                      f"{imaging}.close"):  # fmt: skip
            patch.setattr(f"hil.{place}", lambda *_, name=place.rpartition(".")[2]: self.used.append(name))
        patch.setattr("hil.slave.notify.notify", self.used.append)
        patch.setattr("hil.slave.spawn.start_program", self._start)
        patch.setattr("hil.slave.ros.descriptions._run", lambda name, setup: (MAKERS[name](pickle.loads(setup)), ""))
        patch.setattr("hil.slave.health.reporter.MIN_PERIOD_S", 0.001)
        patch.setenv("UUV_HIL_EMULATED", "a label")
        patch.setattr(daemon, "StopSignals", lambda: nullcontext(self.stop))

    def _publisher(self, _node: str, topic: Any, **_: Any) -> Any:
        def put(payload: bytes, _time: int) -> None:
            self.sent[topic.name].append(payload)
            if all(name in self.sent for name in AWAITED):  # several threads publish
                os.eventfd_write(self.stop, 1)

        return SimpleNamespace(topic=topic, has_subscribers=True, background=False, sequence=1, put=put)

    def _command(self, _node: str, _key: str, deliver: Any, depth: int) -> None:
        shares = encode_accessories(0, {"lights": 0.25, "camera_tilt": 1.0})
        for name, payload in (("vel", ros.encode_twist((0.2, 0.0, 0.0), (0.0, 0.0, 0.0))), ("accessories", shares)):
            deliver(f"cmd_{name}", payload, ros.pack_attachment(1, to_wall_ns(now_ns()), b"m" * 16))

    def _subscribe_to_descriptions(self, key: str, deliver: Any) -> None:
        listener = Node(other := MagicMock(zid="2"), "rviz")
        for name in DESCRIPTIONS if key == SUBSCRIPTIONS else ():
            listener.subscribes(TOPICS[name], "uuv1")
        for call in 2 * other.declare_token.call_args_list:
            deliver(call.args[0], True)

    def _start(self, *words: str) -> Any:
        self.used.append(words)
        return lambda: self.used.append(f"{words[0]} ended")

    def messages(self, name: str) -> list[Any]:
        return [message.decode(TOPICS[name].type, payload) for payload in self.sent[name]]


def test_a_slave_opens_announces_publishes_and_closes_what_its_scenario_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = load_scenario(str(write_scenario(tmp_path, top=SENSORS + TETHER)[0]))
    slave = scenario.slave._replace(realtime=False, deadman=10.0, command_age_limit=10.0)
    routed = scenario.network._replace(router="tcp/127.0.0.1:9", discovery=True)
    sensors = {**scenario.sensors, "imu": scenario.sensors["imu"]._replace(instrument=True)}
    gateway: Any = SimpleNamespace(start=True)
    scenario = scenario._replace(
        vehicle="bluerov2", slave=slave, network=routed, sensors=sensors, mavlink=gateway,
        ros=scenario.ros._replace(wrench=10.0, frame_prefix="v/"),
    )  # fmt: skip
    with nothing_leaks():
        network, startup = Network(monkeypatch), {"exec": now_ns()}
        limit = threading.Timer(PATIENCE_S, os.eventfd_write, (network.stop, 1))
        limit.start()
        gc.disable()
        daemon.run(scenario, None, network.listening, startup, ["a note"])
        limit.cancel()
        os.close(network.stop)
    at = scenario.path, "--connect", slave.listen, "--vehicle", "uuv1"
    assert [each for each in network.used if each != "WATCHDOG=1"] == [
        "READY=1", "watch_router", "answer_searches", "start", ("gateway", "mavlink", *at), ("instruments", *at),
        "STOPPING=1", "instruments ended", "gateway ended", "close", "closed",
    ]  # fmt: skip
    took_ms = (startup["ready"] - startup["exec"]) / NS_PER_MS
    listens, ready, *_, neutral = [line.partition("slave: ")[2] for line in capsys.readouterr().err.splitlines()]
    assert (listens, neutral) == ("it listens", "thrusters neutral")
    assert ready.startswith(f"ready {took_ms:.0f} ms after exec: node uuv1, listening on {slave.listen}, STM32 python ")
    assert (gc.isenabled(), list(startup)) == (True, ["exec", "simulator", "link", "session", "ready"])
    check_graph(network)
    check_messages(network, [f"{name}_link" for name in sensors if name not in ("odometry", "ground_truth")])


def check_graph(network: Network) -> None:
    keys = [call.args[0] for call in network.session.declare_token.call_args_list]
    topics = {(each.kind, each.topic) for each in map(read_token, keys) if each}
    assert {topic for kind, topic in topics if kind == "MS"} == {f"/uuv1/{name}" for name in COMMANDS}
    published = *network.sent, "altitude", "/parameter_events"
    assert {("SS", "/uuv1/arm"), *[("MP", TOPICS[name].full_name("uuv1")) for name in published]} < topics
    assert not [topic for _, topic in topics if "camera" in topic], "the imaging process publishes them"
    watched = [call.args[0] for call in network.session.watch_tokens.call_args_list]
    assert (len([key for key in keys if "/alive/slave/" in key]), "uuv_hil/uuv1/alive/*/**" in watched) == (1, True)
    assert network.session.answer.call_args.args[0] == "uuv_hil/uuv1/last/*"


def check_messages(network: Network, links: list[str]) -> None:
    first = {name: network.messages(name)[0] for name in network.sent}
    accessories, wrench, joints = first["accessories"], first["thruster_wrench"], first["joint_states"]
    stamps = [each["header"]["stamp"] for each in (accessories, wrench, joints, first["tether"])]
    assert stamps == [first["/clock"]["clock"]] * 4
    assert wrench["header"]["frame_id"] == "v/base_link"
    assert len(joints["effort"]) == len(first["motors"]["data"]) / 3 == 6
    level, turned, *_ = [
        {each["child_frame_id"]: each["transform"] for each in frames["transforms"]}
        for frames in network.messages("/tf_static")
    ]
    heads = "dvl_transducer_link", "camera_optical_frame", "forward_sonar_fan"
    assert set(level) == set(turned) == {f"v/{name}" for name in ("odom", *links, *heads)}
    assert level["v/odom"] == level["v/camera_link"] == {"translation": ORIGIN, "rotation": {**ORIGIN, "w": 1.0}}
    assert level["v/camera_optical_frame"]["translation"] == ORIGIN
    lights, tilt, _ = accessories["position"]
    assert (lights, turned["v/camera_link"]["rotation"]["y"]) == pytest.approx((0.25, -sin(tilt * pi / 8)), abs=1e-9)
    lines = [each["msg"] for each in network.messages("/rosout")]
    assert (lines[0], lines[-2:]) == ("a note", ["stopping", "thrusters neutral"])
    figures = Diagnostics((ros.decode_diagnostics(network.sent["diagnostics"][-1]) or [])[0][3])
    assert not [name for name in Diagnostics.FIGURES if name not in figures.raw and not ELSEWHERE.match(name)]
    assert (figures.commands_received, figures.commands_malformed, figures.commands_taken) == (2, 0, 1)
    assert ("WATCHDOG=1" in network.used, len(network.sent["diagnostics"]) > 1) == (True, True), "the last at the end"
    assert (figures.thrusters_unwatched, figures.pings_dropped, figures.link_wire) == ("", 6, "pty")
    assert {name: len(network.sent[name]) for name in DESCRIPTIONS} == dict.fromkeys(DESCRIPTIONS, 1)
    assert '<robot name="bluerov2">' in first["robot_description"]["data"]
    assert len(first["map"]["data"]) == first["map"]["info"]["width"] * first["map"]["info"]["height"]
    assert first["obstacles"] == {"markers": []}, "the pool is empty"


def test_the_thruster_link_is_that_of_the_board_unless_the_scenario_names_one(monkeypatch: pytest.MonkeyPatch) -> None:
    opened, network, scenario = MagicMock(side_effect=DeviceError("none")), MagicMock(), load_scenario("paper_field")
    monkeypatch.setattr(daemon, "open_driver", opened)
    monkeypatch.setattr("boards.detect", lambda: SimpleNamespace(uart="/dev/detected"))
    named, bare = MagicMock(uart="/dev/uart"), MagicMock(uart="")
    cases: Any = (
        ("device", "pty:", named, "/dev/uart"), ("device", "pty:", bare, "pty:"), ("device", "/dev/x", named, "/dev/x"),
        ("device", "pty:", None, "/dev/detected"), ("python", "pty:", named, "pty:"),
    )  # fmt: skip
    for kind, port, board, expected in cases:
        changed = scenario._replace(stm32=kind, link=scenario.link._replace(port=port))
        with pytest.raises(DeviceError):
            daemon.run(changed, board, network, {"exec": 0}, [])
        assert opened.call_args.args[1].port == expected
    with pytest.raises(ConfigError, match="link: baud: "):
        daemon.run(scenario._replace(link=scenario.link._replace(port="/dev/x", baud=1200)), None, network, {}, [])
