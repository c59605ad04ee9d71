"""The tool that measures the cost of rays: a row for each bundle of rays and for each whole sample of a sensor."""

import sys

import pytest

from tools.costs import ray_cost


def test_rays_and_whole_samples_are_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["ray_cost.py", "--rounds", "1"])
    assert ray_cost.main() == 0
    rays, samples = capsys.readouterr().out.split("\n\n")
    assert len(rays.splitlines()) == 7
    assert [line.split(",")[0].split(" with")[0] for line in samples.splitlines()[1:]] == [
        "forward-looking sonar", "side-scan sonar", "camera",
    ]  # fmt: skip
