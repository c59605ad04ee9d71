"""A recording that the live view starts and ends."""

import os
import re
from pathlib import Path

import pytest

from hil.recording.reader import read_messages
from hil.scenario.config import load_scenario
from hil.view.sources.live import LiveSource
from tests.support.processes import Program, wait_for, write_scenario

pytest.importorskip("mcap", reason="recordings need the extra record")


def test_a_recording_of_the_view_has_the_messages_of_the_vehicle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, port = write_scenario(tmp_path)
    monkeypatch.chdir(tmp_path)
    with (
        Program(tmp_path, "slave", path),
        LiveSource([f"tcp/127.0.0.1:{port}"], observe=True, scenario=load_scenario(str(path))) as source,
    ):
        recorder = source.recorder
        assert recorder.stop() == "no recording runs"
        folder = recorder.start().removeprefix("recording into ")
        assert recorder.start() == f"recording into {folder}", "one at a time"
        assert wait_for(lambda: int(recorder.state.split()[0]) > 50), recorder.state
        reported = recorder.stop()
        assert re.search(rf"messages recorded, (none|\d+) lost: {folder}$", reported), reported
        assert not recorder.state
        assert os.listdir(folder)
        messages = list(read_messages(folder))
        assert len(messages) == int(reported.split()[0])
        assert "/uuv1/odom" in {message.topic for message in messages}
        again = recorder.start().removeprefix("recording into ")
        assert again != folder
    assert wait_for((Path(again) / "metadata.yaml").exists), "the end of the view ends it"
