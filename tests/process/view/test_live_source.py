"""The source of the live view receives only what the view draws."""

from pathlib import Path

from hil.view.sources.live import LiveSource
from tests.support.processes import slave_with, wait_for


def test_only_positions_are_received_until_somebody_looks(tmp_path: Path) -> None:
    with slave_with(tmp_path, "") as endpoint, LiveSource([endpoint], observe=True) as source:
        assert wait_for(lambda: source.names == ["uuv1"] and {"odom", "ground_truth"} <= set(source.latest("uuv1")))
        source.show(viewed=False, with_pictures=True)
        first = source.latest("uuv1")["odom"]
        assert wait_for(lambda: source.latest("uuv1")["odom"] != first)
        assert "imu" not in source.latest("uuv1")
        source.show(viewed=True, with_pictures=False)
        assert wait_for(lambda: "imu" in source.latest("uuv1"))
