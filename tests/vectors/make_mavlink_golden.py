"""Writes mavlink_thruster.json: the packets of a thruster link as plain pymavlink makes them.

Run by hand when a message is added. Two lists: what a host (1/191) or a ground station (255/190) says to a device
(1/1) with six thrusters that has just been switched on, in this order, with what must then hold; and what that
device may say. Packet numbers count per sender. A nan is written as null.
"""

import json
import os
from typing import Any

import pymavlink
from pymavlink.dialects.v20 import ardupilotmega as dialect

CHANNELS = 6
KEY = bytes(range(32))
TIMESTAMP = 10**13  # 10 us each, since 2015
NAN = float("nan")
NEUTRAL = [1500] * CHANNELS
DEVICE = (1, 1)
HELD = [1100, 1300, 1499, 1501, 1700, 1900]

HOST, GROUND, BOARD = dialect.MAVLink(None, 1, 191), dialect.MAVLink(None, 255, 190), dialect.MAVLink(None, 1, 1)


def long(command: int, *params: float) -> Any:
    seven = [*params, *[0.0] * (7 - len(params))]
    return dialect.MAVLink_command_long_message(*DEVICE, command, 0, *[float(value) for value in seven])


def servos(stamp_us: int, pulses: list[int]) -> Any:
    return dialect.MAVLink_servo_output_raw_message(stamp_us, 0, *pulses, *[0] * (16 - len(pulses)))


def controls(mode: int, values: list[float]) -> Any:
    return dialect.MAVLink_hil_actuator_controls_message(1_000_000, values + [0.0] * (16 - len(values)), mode, 0)


def sent_to_the_device() -> list[dict[str, Any]]:
    """sender, message, then whether it is armed and its pulses, and the result it acknowledges (None: it does not)."""
    turned = [*HELD[:2], 1650, *HELD[3:]]
    rows: list[tuple[str, Any, Any, bool, list[int], int | None]] = [
        ("heartbeat", HOST, dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), False, NEUTRAL, None),
        ("pulses while disarmed", HOST, servos(1, HELD), False, NEUTRAL, None),
        ("set a servo while disarmed", GROUND, long(183, 3, 1650), False, NEUTRAL, 1),
        ("arm", HOST, long(400, 1), True, NEUTRAL, 0),
        ("pulses", HOST, servos(1_000_000, HELD), True, HELD, None),
        ("arm again", HOST, long(400, 1), True, HELD, 0),
        ("set a servo", GROUND, long(183, 3, 1650), True, turned, 0),
        ("set a servo that is not there", GROUND, long(183, 7, 1650), True, turned, 2),
        ("unknown command", GROUND, long(22, 1), True, turned, 3),
        ("one pulse off", HOST, servos(2_000_000, [0, *HELD[1:]]), True, [0, *HELD[1:]], None),
        (
            "override two channels, give one back",
            GROUND,
            dialect.MAVLink_rc_channels_override_message(*DEVICE, 65535, 0, 1234, 65535, 65535, 65535, 65535, 65535),
            True,
            [0, 1500, 1234, *HELD[3:]],
            None,
        ),
        ("disarm", HOST, long(400, 0), False, NEUTRAL, 0),
        (
            "controls, one of them off",
            HOST,
            controls(128, [-1.0, 1.0, 0.5, -0.0025, NAN, 0.0]),
            True,
            [1100, 1900, 1700, 1499, 0, 1500],
            None,
        ),
        ("controls disarmed", HOST, controls(0, [1.0] * CHANNELS), False, NEUTRAL, None),
        ("ask the time", GROUND, dialect.MAVLink_timesync_message(0, 1_234_567_890), False, NEUTRAL, None),
        (
            "what others say",
            GROUND,
            dialect.MAVLink_attitude_message(7, 0.5, -0.25, 0.125, 0.0, 0.0, 1.0),
            False,
            NEUTRAL,
            None,
        ),
    ]
    return [
        packet(name, mavlink, message) | {"armed": armed, "pwm_us": pulses, "result": result}
        for name, mavlink, message, armed, pulses, result in rows
    ]


def sent_by_the_device() -> list[dict[str, Any]]:
    return [
        packet("heartbeat disarmed", BOARD, dialect.MAVLink_heartbeat_message(12, 0, 0, 0, 3, 3)),
        packet("heartbeat armed", BOARD, dialect.MAVLink_heartbeat_message(12, 0, 128, 0, 4, 3)),
        packet("status armed", BOARD, status(enabled=32768, health=32768)),
        packet("report", BOARD, servos(1_234_567, HELD)),
        packet("heartbeat timed out", BOARD, dialect.MAVLink_heartbeat_message(12, 0, 0, 0, 5, 3)),
        packet("status timed out", BOARD, status(enabled=0, health=0)),
        packet("acknowledgement", BOARD, dialect.MAVLink_command_ack_message(400, 0, 0, 0, 1, 191)),
        packet("time", BOARD, dialect.MAVLink_timesync_message(9_876_543_210, 1_234_567_890)),
        packet(
            "escs",
            BOARD,
            dialect.MAVLink_esc_telemetry_1_to_4_message(
                [31, 32, 33, 34], [1481] * 4, [325, 425, 525, 625], [200] * 4, [955, 964, 974, 984], [1] * 4
            ),
        ),
    ]


def status(enabled: int, health: int) -> Any:
    return dialect.MAVLink_sys_status_message(
        32768, enabled, health, 0, 65535, -1, -1, 0, errors_comm=258, errors_count1=3, errors_count2=65535,
        errors_count3=0, errors_count4=0,
    )  # fmt: skip


def signed() -> dict[str, Any]:
    """Return the host's arming, signed; with a new sender of its own so that its packets are numbered from 0."""
    mavlink = dialect.MAVLink(None, 1, 191)
    mavlink.signing.secret_key = KEY
    mavlink.signing.timestamp = TIMESTAMP
    mavlink.signing.sign_outgoing = True
    return packet("arm, signed", mavlink, long(400, 1)) | {"key": KEY.hex(), "timestamp": TIMESTAMP}


def packet(name: str, mavlink: Any, message: Any) -> dict[str, Any]:
    """Return the packet as a row of the file."""
    fields = {key: plain(value) for key, value in message.to_dict().items() if key != "mavpackettype"}
    row = {
        "name": name,
        "system": mavlink.srcSystem,
        "component": mavlink.srcComponent,
        "number": mavlink.seq,
        "message": message.get_type(),
        "fields": fields,
        "bytes": message.pack(mavlink).hex(),
    }
    mavlink.seq += 1
    return row


def plain(value: Any) -> Any:
    """Return the value as JSON has it."""
    if isinstance(value, list):
        return [plain(item) for item in value]
    return None if value != value else value


def golden() -> dict[str, Any]:
    """Return the contents of the file."""
    for mavlink in (HOST, GROUND, BOARD):
        mavlink.seq = 0
    return {
        "source": f"pymavlink {pymavlink.__version__}, dialect ardupilotmega",
        "channels": CHANNELS,
        "to_device": sent_to_the_device(),
        "from_device": sent_by_the_device(),
        "signed": signed(),
    }


if __name__ == "__main__":
    with open(os.path.join(os.path.dirname(__file__), "mavlink_thruster.json"), "w", encoding="utf-8") as file:
        json.dump(golden(), file, indent=1)
        file.write("\n")
