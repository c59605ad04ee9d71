"""The page of the topics: name, message type, rate and quality of service, out of the table of topics."""

from hil.ros.topics import COMMANDS, TOPICS, Topic

HEAD = """\
# Topics

Every topic is a ROS 2 message. `NODE` is the name of the vehicle, `[slave] node`. A sensor's topic is there when the
sensor is fitted, at the rate of its section; the table has the usual rate. Frames are ENU and FLU (REP 103).

This page is made by `python -m tools.reference` from `hil/ros/topics.py`.

"""
TABLE = "| topic | type | rate (Hz) | quality of service |\n|---|---|---|---|\n"


def page() -> str:
    """Return the page of all topics."""
    parts, topics = [HEAD], TOPICS.values()
    for title, chosen in (
        ("Commands to a vehicle", [t for t in topics if t.name in COMMANDS]),
        ("Between the planners of a fleet", [t for t in topics if t.from_master and t.name not in COMMANDS]),
        ("From a vehicle", [t for t in topics if not t.from_master]),
    ):
        parts.append(f"## {title}\n\n{TABLE}{''.join(map(_row, chosen))}\n")
    return "".join(parts).rstrip() + "\n"


def _row(topic: Topic) -> str:
    rate = f"{topic.rate_hz:g}" if topic.rate_hz else "on events"
    qos = ["reliable" if topic.qos.reliable else "best effort", f"depth {topic.qos.depth}"]
    qos += ["latched"] if topic.qos.latched else []
    return f"| `{topic.full_name('NODE')}` | `{topic.type}` | {rate} | {', '.join(qos)} |\n"
