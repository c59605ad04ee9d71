"""Write the index of a recording, metadata.yaml, as rosbag2 does: a folder with it is a bag.

Version 5 of the format, which every ROS 2 since Humble reads (rosbag2_storage/metadata_io.cpp).
"""

import os
from collections.abc import Iterable, Sequence

from hil.common.tables import write_atomically
from hil.recording.mcap_file import FileSummary, qos_profile

NAME = "metadata.yaml"


def write_index(folder: str, files: Sequence[FileSummary]) -> None:
    """Write the index of `files`, in the order of their recording; it replaces an older index. Raises OSError."""
    write_atomically(os.path.join(folder, NAME), _text(files))


def _text(files: Sequence[FileSummary]) -> str:
    counts: dict[tuple[str, str], int] = {}
    for summary in files:
        for topic, kind, messages in summary.topics:
            counts[topic, kind] = counts.get((topic, kind), 0) + messages
    lines = [
        "rosbag2_bagfile_information:",
        "  version: 5",
        "  storage_identifier: mcap",
        *_span("  ", files),
        f"  message_count: {sum(counts.values())}",
        "  topics_with_message_count:" + ("" if counts else " []"),
        *[line for (topic, kind), messages in counts.items() for line in _topic(topic, kind, messages)],
        '  compression_format: ""',
        '  compression_mode: ""',
        "  relative_file_paths:",
        *[f"    - {os.path.basename(summary.path)}" for summary in files],
        "  files:",
        *[line for summary in files for line in _file(summary)],
    ]
    return "\n".join(lines) + "\n"


def _span(indent: str, files: Iterable[FileSummary]) -> list[str]:
    """Return the lines with the time of the first message, and the duration until the last."""
    filled = [summary for summary in files if summary.topics]
    first = min((summary.first_ns for summary in filled), default=0)
    last = max((summary.last_ns for summary in filled), default=0)
    return [
        f"{indent}duration: {{nanoseconds: {last - first}}}",
        f"{indent}starting_time: {{nanoseconds_since_epoch: {first}}}",
    ]


def _topic(topic: str, kind: str, messages: int) -> list[str]:
    profile = qos_profile(topic).replace("\n", "\\n")
    return [
        "    - topic_metadata:",
        f"        name: {topic}",
        f"        type: {kind}",
        "        serialization_format: cdr",
        f'        offered_qos_profiles: "{profile}"',
        f"      message_count: {messages}",
    ]


def _file(summary: FileSummary) -> list[str]:
    return [
        f"    - path: {os.path.basename(summary.path)}",
        *_span("      ", [summary]),
        f"      message_count: {sum(topic.messages for topic in summary.topics)}",
    ]
