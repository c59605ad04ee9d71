"""Commands are on time on a full link, and arrive over one that loses packets."""

import json
import time
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest

from hil.client.delay import quantiles
from hil.ros.diagnostics import Diagnostics, or_nan
from tests.support.busy import retried_when_busy
from tests.support.output_lines import Lines
from tests.support.processes import write_scenario
from tools.faults.spaces import Network

pytestmark = pytest.mark.netns

ENDPOINT = "tcp/{}:7447"


@retried_when_busy("figures of processes that have their turns")
def test_commands_arrive_over_a_link_with_loss_and_jitter(tmp_path: Path) -> None:
    """The link loses 5 % of packets and delays 0 to 50 ms each way: commands are slower, but never late."""
    scenario, _ = write_scenario(tmp_path, allow="", host="0.0.0.0", port=7447)
    ending = tmp_path / "end"
    ending.write_text("")
    with Network("slave", "master") as network, ExitStack() as stack:
        reported = {
            name: stack.enter_context(closing(Lines(tmp_path / f"{name}.txt"))) for name in ("wire", "slave", "master")
        }
        spaces = [network.space(machine) for machine in ("slave", "master")]
        network.start("", "tests/system/netns/bad_wire.py", *spaces, 0.05, 0.05, output=reported["wire"].file)
        reported["wire"].first("carrying", time.monotonic(), 60)
        network.start("slave", "-m", "hil.cli", "slave", scenario, output=reported["slave"].file)
        script = "tests/system/netns/commander.py"
        arguments = (script, scenario, ENDPOINT.format("10.79.0.1"), ending)
        master = network.start("master", *arguments, output=reported["master"].file)
        reported["master"].first("commanding", time.monotonic(), 60)
        time.sleep(8)
        ending.write_text("end")
        master.wait(60)
        reported["master"].first("delays_ms", 0.0, time.monotonic() + 60)
        figures: dict[str, Any] = json.loads(reported["master"].seen[-1][1])
        losses = sum("is lost" in line for _, line in reported["master"].seen)
    delay, counts = quantiles([round(ms * 1e6) for ms in figures["delays_ms"]]), Diagnostics(figures["diagnostics"])
    print(
        delay,
        len(figures["delays_ms"]),
        losses,
        {name: text for name, text in counts.raw.items() if "command" in name or "clock" in name},
    )
    assert len(figures["delays_ms"]) > 200, "of 400"
    assert delay.p50_ms < 150
    assert delay.max_ms < 500 + 50
    assert losses <= 2
    assert len([at for at in figures["came"] if at > figures["came"][-1] - 5]) > 60, "of 100 samples in five seconds"
    assert or_nan(counts.clock_uncertainty_ms) < 60
    assert abs(or_nan(counts.clock_offset_ms)) <= or_nan(counts.clock_uncertainty_ms)
