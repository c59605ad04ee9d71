"""Write the index of a recording, metadata.yaml, as rosbag2 does: a folder with it is a bag.

Version 5 of the format, which every ROS 2 since Humble reads (rosbag2_storage/metadata_io.cpp).
"""

import json
import os
from collections.abc import Iterable, Sequence

from hil.common.tables import write_atomically
from hil.recording.mcap_file import FileSummary, qos_profile

NAME = "metadata.yaml"


def write_index(folder: str, files: Sequence[FileSummary]) -> None:
    """Write the index of `files`, in the order of their recording; it replaces an older index. Raises OSError."""
    counts: dict[tuple[str, str], int] = {}
    for summary in files:
        for topic, kind, messages in summary.topics:
            counts[topic, kind] = counts.get((topic, kind), 0) + messages
    names = [os.path.basename(summary.path) for summary in files]
    about = {
        "version": 5,
        "storage_identifier": "mcap",
        **_span(files),
        "message_count": sum(counts.values()),
        "topics_with_message_count": [
            {"topic_metadata": {"name": topic, "type": kind, "serialization_format": "cdr",
                                "offered_qos_profiles": qos_profile(topic)}, "message_count": messages}
            for (topic, kind), messages in counts.items()
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": names,
        "files": [
            {"path": name, **_span([summary]), "message_count": sum(topic.messages for topic in summary.topics)}
            for name, summary in zip(names, files, strict=True)
        ],
    }  # fmt: skip
    # JSON is YAML as well
    write_atomically(os.path.join(folder, NAME), json.dumps({"rosbag2_bagfile_information": about}, indent=1) + "\n")


def _span(files: Iterable[FileSummary]) -> dict[str, dict[str, int]]:
    """Return the time of the first message, and the duration until the last."""
    filled = [summary for summary in files if summary.topics]
    first = min((summary.first_ns for summary in filled), default=0)
    last = max((summary.last_ns for summary in filled), default=0)
    return {"duration": {"nanoseconds": last - first}, "starting_time": {"nanoseconds_since_epoch": first}}
