"""Missions sent to the MAVLink gateway."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.support.clients.mavlink_vehicle import Partner

ACCEPTED, UNSUPPORTED, DENIED = (
    dialect.MAV_RESULT_ACCEPTED,
    dialect.MAV_RESULT_UNSUPPORTED,
    dialect.MAV_RESULT_DENIED,
)


HOME_ROW = (0, 16, 0.0, 0.0, 0.0)


def upload_mission(partner: Partner, rows: list[tuple[Any, ...]], count: int | None = None) -> int | None:
    """Upload items (frame, command, x, y, z, and four parameters); return the MAV_MISSION_RESULT."""
    partner.send(dialect.MAVLink_mission_count_message(1, 1, len(rows) if count is None else count, 0))
    while requests := partner.take_messages("MISSION_REQUEST_INT"):
        frame, command, x, y, z, *params = rows[requests[-1].seq]
        four = [*params, *[0.0] * (4 - len(params))]
        partner.send(
            dialect.MAVLink_mission_item_int_message(
                1, 1, requests[-1].seq, frame, command, 0, 1, *four, round(x * 1e4), round(y * 1e4), z
            )
        )
    acks = partner.take_messages("MISSION_ACK")
    return acks[0].type if acks else None
