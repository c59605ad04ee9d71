"""Each browser gets what has changed since its last message."""

import json
from typing import Any

from hil.view.feed import Encoded, Feed, pack


def changes(feed: Feed, since: int) -> tuple[int, dict[str, Any], list[str]]:
    version, text = feed.changes(since)
    found = json.loads(text)
    return version, found["values"], [line for _, _, line in found["log"]]


def test_only_changes_are_sent_and_all_of_them_to_a_new_browser() -> None:
    feed = Feed(lambda: {"track/uuv1": [[1.0, 2.0, 3.0]]})
    feed.set("motion", {"uuv1": {"depth": float("nan"), "thrusts": (1.0, float("inf"))}})
    feed.add_log_line("uuv1 is connected")
    version, values, lines = changes(feed, 0)
    assert values == {"track/uuv1": [[1.0, 2.0, 3.0]], "motion": {"uuv1": {"depth": None, "thrusts": [1.0, None]}}}
    assert lines == ["uuv1 is connected"]
    feed.set("motion", {"uuv1": {"depth": float("nan"), "thrusts": (1.0, float("inf"))}})
    assert changes(feed, version) == (version, {}, []), "nothing has changed"
    feed.set("recording", {"state": ""})
    later, values, lines = changes(feed, version)
    assert (later > version, values, lines) == (True, {"recording": {"state": ""}}, [])


def test_a_browser_gets_the_newest_of_the_pictures_that_it_shows() -> None:
    feed = Feed()
    for number in range(3):
        feed.set_picture("uuv1/camera", Encoded({"number": number}, b"jpeg"))
    feed.set_picture("uuv1/side_scan", Encoded({}, b"other"))
    assert [picture.header for picture in feed.pictures(("uuv1/camera",), 0)] == [{"number": 2}]
    version, _ = feed.changes(0)
    assert feed.pictures(("uuv1/camera",), version) == []


def test_a_packed_message_is_aligned_for_arrays() -> None:
    data = pack({"a": 1}, b"\x01\x02")
    size = int.from_bytes(data[:4], "little")
    assert size % 4 == 0
    assert json.loads(data[4 : 4 + size]) == {"a": 1}
    assert data[4 + size :] == b"\x01\x02"
