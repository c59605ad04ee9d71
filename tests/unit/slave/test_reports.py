"""What a slave reports of itself and its surroundings: status, figures of its machine, log lines, its recorded run."""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from boards.tree import Tree
from hil.common.clock import NS_PER_MS, NS_PER_S, Histogram, now_ns
from hil.recording.events import decode_event
from hil.ros import encoders as ros
from hil.ros.diagnostics import Diagnostics
from hil.scenario.config import load_scenario
from hil.slave import log as log_module
from hil.slave import router_watch, slave_recorder
from hil.slave.health import machine_figures
from hil.slave.health.machine_figures import add_machine_figures
from hil.slave.health.reporter import Health, bytecode_compiled
from hil.slave.log import MAX_LINES, WINDOW_NS, Log
from sim.vehicle.failures import Failure

STEP_NS = 2_500_000
FILES = {
    "proc/net/dev": "Inter-| Receive\n lo: 100 1 0 0 0 0 0 0 200 1\neth0: 30 1 0 0 0 0 0 0 4\n eth1: 5 1\n",
    "proc/meminfo": "MemTotal: 9999 kB\nMemAvailable: 4194304 kB\n",
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_cur_freq": "1500000\n",
    "etc/systemd/system/uuv-hil-slave.service": "",
    "etc/systemd/system/uuv-hil-can.service": "",  # it prepares the board, and ends
    "sys/fs/cgroup/systemd/system.slice/uuv-hil-slave.service/tasks": "",
}


def test_the_figures_of_a_machine_are_those_of_its_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures = Diagnostics()
    add_machine_figures(figures, Tree(str(tmp_path)), None)
    assert (figures.cpu_mhz, figures.memory_available_mib, figures.services, figures.throttled) == (None,) * 4
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    for services in ("running", "not running: web"):
        add_machine_figures(figures, Tree(str(tmp_path)), None)
        assert figures.services == services
        (tmp_path / "etc/systemd/system/uuv-hil-web.service").touch()
    assert (figures.cpu_mhz, figures.memory_available_mib) == (1500.0, 4096.0)
    assert (figures.network_received_bytes, figures.network_sent_bytes) == (130, 204)
    hot: Any = lambda *_, ask_firmware: SimpleNamespace(now=() if ask_firmware else ("hot", "weak"), known=False)  # noqa: E731
    monkeypatch.setattr(machine_figures, "throttling", hot)
    monkeypatch.setattr(machine_figures, "temperature", lambda *_: 0.0)
    add_machine_figures(figures, Tree(str(tmp_path)), None)
    assert (figures.throttled, figures.temperature_c) == ("hot; weak", 0.0)


def part(**members: Any) -> Any:
    """Return a part of a slave that adds no figures."""
    return SimpleNamespace(add_figures=lambda _: None, **members)


def test_the_status_is_that_of_the_worst_part() -> None:
    problems, published = {"link": "", "source": ""}, list[Any]()
    driver, source = (part(problem=lambda name=name: problems[name], children=(1, 2)) for name in problems)
    publisher = part(publish_diagnostics=lambda *status: published.append(status))
    schedule = SimpleNamespace(lateness=Histogram())
    loop = part(driver=driver, source=source, sample_publisher=publisher, schedule=schedule)
    link = load_scenario("paper_field").link
    startup = {"exec": now_ns() - NS_PER_S, "ready": now_ns() - NS_PER_S + 30 * NS_PER_MS}
    health = Health(loop, (), Log("slave"), startup, ["a", "b"], None, link, part(), part(children=(3,)))
    states = [(("", ""), 0, "running"), (("", "waits"), 1, "waits"), (("lost", "waits"), 2, "lost")]
    for (problems["link"], problems["source"]), level, text in states:
        health._publish()
        assert published[-1][:3] == ("slave", level, text)
    figures = Diagnostics(published[-1][3])
    assert (figures.realtime, figures.processes, figures.link_baud) == ("a; b", 4, link.baud)
    assert 1.0 <= (figures.uptime_s or 0.0) < 60.0
    assert float(figures.raw["startup_ready_ms"]) == pytest.approx(30.0, abs=1.0)


def test_the_log_says_what_it_has_left_out(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    now, published = [5 * NS_PER_S], list[str]()
    monkeypatch.setattr(log_module, "now_ns", lambda: now[0])
    log = Log("slave")
    log.publish = published.append

    def written() -> list[str]:
        log.flush()
        return capsys.readouterr().err.splitlines()

    now[0] += NS_PER_S // 4
    log.write_line("ready")
    assert log.wakeup.is_set()
    assert (written(), published) == (["[    0.250] slave: ready"], ["ready"])
    for _ in range(2):
        now[0] += WINDOW_NS + 1
        for number in range(MAX_LINES + 3):
            log.write_line(f"line {number}")
        now[0] += WINDOW_NS
        assert len(written()) == MAX_LINES
        now[0] += 1
        assert [line.partition("e: ")[2] for line in written()] == ["3 lines left out: more than 1000 in 10 s"]
    published.clear()
    for text in ("silent", "silent", "silent", "ready", "ready"):
        log.write_line(text)
    for _ in range(2):
        now[0] += WINDOW_NS + 1
        log.write_line("ready")
        log.flush()
    assert published == ["silent", "2 times more: silent", "ready", "1 times more: ready", "1 times more: ready"]


def test_a_run_is_recorded_by_the_steps_of_its_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    about, used, messages = dict[str, str](), list[str](), list[Any]()
    end = SimpleNamespace(put=messages.append, close=lambda: used.append("closed"))
    monkeypatch.setattr(slave_recorder, "Recorder", lambda *_: end)
    monkeypatch.setattr(slave_recorder, "describe", lambda *_, **texts: (about.update(texts), ()))
    monkeypatch.setattr(slave_recorder, "new_folder", lambda *_: "runs/uuv1")
    with slave_recorder.SlaveRecorder(load_scenario("paper_field"), "a board", 77, print) as recorder:
        for step, pulses in enumerate([(1500, 1500), (1500, 1500), (1600, 1500), (1600, 1500)], 5):
            recorder.record_step(step * STEP_NS, pulses)
        recorder.record_state(9 * STEP_NS, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.0,) * 6)
        recorder.record_failures(10 * STEP_NS, [Failure("bow", "off")])
        for step in (11, 12):
            recorder.record_epoch(step * STEP_NS, 30 + step)
        receive = recorder.record_received(lambda name, *_: used.append(name))
        receive("cmd_vel", b"payload", ros.pack_attachment(6, 1234, b"g" * 16))
        receive("cmd_depth", b"payload", b"no stamp")
        receive("cmd_nothing", b"payload", b"")
    assert about == {"board": "a board", "epoch_ns": "77", "step_ns": str(STEP_NS)}
    assert used == ["cmd_vel", "cmd_depth", "cmd_nothing", "closed"]
    assert [message.sequence for message in messages] == [1, 2, 1, 2, 1, 2, 6, 0]
    numbers = [ros.decode_int64_array(messages[place].data) for place in (0, 1, 4, 5)]
    assert numbers == [(5, 1500, 1500), (7, 1600, 1500), (11, 41), (12, 42)]
    assert [decode_event(message.data)["step"] for message in messages[2:4]] == [9, 10]
    assert messages[6].published_ns == 1234 < messages[6].logged_ns <= messages[7].logged_ns == messages[7].published_ns


def test_modules_in_c_need_no_bytecode(monkeypatch: pytest.MonkeyPatch) -> None:
    package, twin, late = ModuleType("made_up"), ModuleType("made_up._twin"), ModuleType("made_up.late")
    monkeypatch.setattr(package, "__cached__", __file__, raising=False)
    twin.__file__, late.__file__ = "_twin.abi3.so", "late.py"
    assert not bytecode_compiled("made_up"), "nothing of it is loaded"
    for module, is_compiled in ((package, True), (twin, True), (late, False)):
        monkeypatch.setitem(sys.modules, module.__name__, module)
        assert bytecode_compiled("made_up") == is_compiled


def test_a_router_that_is_not_reached_is_reported_when_the_reason_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    lines, checks, found = list[str](), list[Any](), list[Any]()
    monkeypatch.setattr(router_watch, "has_connected", lambda *_: not found[0])
    monkeypatch.setattr(router_watch, "why_not", lambda *_, routed: SimpleNamespace(text=found[0]) if routed else None)
    session: Any = SimpleNamespace(every=lambda _period, check, _name: checks.append(check))
    router_watch.watch_router(session, "tcp/there:7447", None, lines.append)
    for found[:] in (["off"], ["off"], ["slow"], [""], ["slow"]):
        checks[0]()
    assert lines == [f"the router tcp/there:7447 is not reached: {reason}" for reason in ("off", "slow", "slow")]
