"""Parameters, missions, files, logs, streams and rights of the MAVLink vehicle, packet by packet."""

from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common import __version__
from hil.gateways.mavlink.flight.modes import Mode
from hil.gateways.mavlink.parameter_table import GATEWAY, ParameterTable
from hil.gateways.mavlink.protocols import ftp
from tests.support.clients.mavlink_missions import ACCEPTED, DENIED, HOME_ROW, UNSUPPORTED, upload_mission
from tests.support.clients.mavlink_vehicle import Bench
from tests.support.clients.qgroundcontrol import unpack


def test_every_command_is_acknowledged() -> None:
    bench = Bench()
    for number in range(3000):
        if number != dialect.MAV_CMD_COMPONENT_ARM_DISARM:
            assert bench.partner.command(number) is not None, number
    assert bench.partner.command(2999) == UNSUPPORTED
    bench.partner.send(dialect.MAVLink_command_int_message(1, 1, 0, 2999, 0, 0, 0, 0, 0, 0, 0, 0, 0))
    assert [ack.result for ack in bench.partner.take_messages("COMMAND_ACK")] == [UNSUPPORTED]


def test_all_parameters_are_sent_once_with_their_indices() -> None:
    bench = Bench()
    bench.partner.send(dialect.MAVLink_param_request_list_message(1, 1))
    bench.run(0.2)
    values = bench.partner.take_messages("PARAM_VALUE")
    assert [value.param_index for value in values] == list(range(len(values)))
    assert {value.param_count for value in values} == {len(values)}
    names = [value.param_id for value in values]
    assert names == sorted([*GATEWAY, *bench.vehicle.values])
    assert all(len(name) <= 16 for name in names)


def test_parameters_are_read_by_name_and_index_and_unknown_ones_ignored() -> None:
    bench = Bench()
    bench.partner.send(dialect.MAVLink_param_request_read_message(1, 1, b"WPNAV_SPEED", -1))
    (value,) = bench.partner.take_messages("PARAM_VALUE")
    assert (value.param_id, value.param_value, value.param_type) == ("WPNAV_SPEED", 50.0, dialect.MAV_PARAM_TYPE_REAL32)
    bench.partner.send(dialect.MAVLink_param_request_read_message(1, 1, b"", value.param_index))
    assert bench.partner.take_messages("PARAM_VALUE")[0].param_id == "WPNAV_SPEED"
    for name, index in ((b"NONE", -1), (b"", 9999), (b"_HASH_CHECK", -1)):
        bench.partner.send(dialect.MAVLink_param_request_read_message(1, 1, name, index))
    assert bench.partner.take_messages("PARAM_VALUE") == []


def test_a_set_parameter_is_reported_to_all_ground_stations() -> None:
    bench = Bench()
    other = bench.add_partner(system=254)

    def set_one(name: bytes, value: float) -> list[float]:
        bench.partner.send(dialect.MAVLink_param_set_message(1, 1, name, value, dialect.MAV_PARAM_TYPE_REAL32))
        bench.run(0.1)
        return [value.param_value for value in bench.partner.take_messages("PARAM_VALUE")]

    assert set_one(b"WPNAV_SPEED", 150.0) == [150.0]
    assert len(other.take_messages("PARAM_VALUE")) == 1
    assert set_one(b"WPNAV_SPEED", 1e9) == [150.0]
    assert "not between" in bench.partner.texts()
    assert set_one(b"WPNAV_SPEED", float("nan")) == [150.0]
    assert set_one(b"FS_GCS_ENABLE", 3.4) == [3.0]
    assert set_one(b"NONE", 1.0) == []
    assert set_one(b"HIL_G_SURGE_P", 2.5) == [2.5]
    assert bench.vehicle.values["HIL_G_SURGE_P"] == 2.5


def test_parameters_are_saved_and_a_broken_file_is_reported(tmp_path: Path) -> None:
    path = str(tmp_path / "deep" / "vehicle.toml")
    assert ParameterTable(path).set("WPNAV_RADIUS", 200.0) == ""
    assert ParameterTable(path)["WPNAV_RADIUS"] == 2.0, "in m here"
    Path(path).write_text('WPNAV_RADIUS = 300.0\nWPNAV_SPEED = "fast"\nFRAME_CONFIG = 1\n', encoding="utf-8")
    table = ParameterTable(path)
    assert (table["WPNAV_RADIUS"], table["WPNAV_SPEED"], len(table.faults)) == (3.0, 0.5, 2)
    assert table.set("JS_GAIN_STEPS", 5.0) == ""
    assert Path(path).read_text() == "JS_GAIN_STEPS = 5.0\nWPNAV_RADIUS = 300.0\n", "what differs from its default"
    Path(path).write_text("WPNAV_SPEED = 1e9\nWPNAV_RADIUS = -1.0\nJS_GAIN_STEPS = true\nNONE = 1\n")
    assert len(ParameterTable(path).faults) == 4
    assert "not stored" in ParameterTable(f"{path}/file").set("WPNAV_RADIUS", 200.0)
    Path(path).write_text("not toml", encoding="utf-8")
    assert "defaults are used" in ParameterTable(path).faults[0]


def _ftp(
    bench: Bench, opcode: int, text: bytes = b"", session: int = 0, offset: int = 0, size: int | None = None
) -> list[Any]:
    number = getattr(bench, "ftp_number", 0)
    bench.ftp_number = number + 1000  # type: ignore[attr-defined]
    payload = ftp.HEADER.pack(number, session, opcode, len(text) if size is None else size, 0, 0, offset) + text
    bench.partner.send(ftp.ftp_message(payload, 1, 1))
    bench.run(0.2)
    replies: list[tuple[Any, ...]] = []
    for message in bench.partner.take_messages("FILE_TRANSFER_PROTOCOL"):
        data = bytes(message.payload)
        head = ftp.HEADER.unpack_from(data)
        is_last = len(replies) == ftp.BURST_AT_ONCE - 1
        assert (head[0], *head[4:6]) == (number + 1 + len(replies) & 0xFFFF, opcode, is_last)
        replies.append((head[2], head[1], head[6], data[ftp.HEADER.size : ftp.HEADER.size + head[3]]))
    return replies


def test_parameters_can_be_read_as_one_file() -> None:
    bench = Bench()
    ((kind, session, _, size),) = _ftp(bench, ftp.OPEN_READ, b"@PARAM/param.pck?withdefaults=1\0")
    assert kind == ftp.ACK
    answers = _ftp(bench, ftp.BURST, session=session, size=239)
    data = b"".join(part for kind, _, _, part in answers if kind == ftp.ACK)
    assert answers[-1][3] == bytes((ftp.END_OF_FILE,))
    assert len(data) == int.from_bytes(size, "little")
    assert unpack(data) == pytest.approx({name: bench.table.value(name) for name in bench.table.names()}, rel=1e-6)
    assert _ftp(bench, ftp.TERMINATE, session=session)[0][0] == ftp.ACK
    assert _ftp(bench, ftp.READ, session=session, size=10)[0][3] == bytes((ftp.BAD_SESSION,))


def test_only_logs_can_be_read(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "run.mcap").write_bytes(bytes(range(256)) * 4)
    (tmp_path / "secret").write_text("x", encoding="ascii")
    (tmp_path / "logs" / "link").symlink_to(tmp_path / "secret")
    bench = Bench(folder=str(tmp_path / "logs"))
    assert _ftp(bench, ftp.LIST, b"/\0")[0][3] == b"D@PARAM\0Dlogs\0"
    (tmp_path / "logs" / "old").mkdir()
    (tmp_path / "logs" / "lost").symlink_to(tmp_path / "nothing")
    assert _ftp(bench, ftp.LIST, b"/logs\0")[0][3] == b"Flink\t1\0S\0Dold\0Frun.mcap\t1024\0"
    ((_, session, _, _),) = _ftp(bench, ftp.OPEN_READ, b"/logs/run.mcap\0")
    assert _ftp(bench, ftp.READ, session=session, offset=1000, size=239)[0][3] == bytes(range(256))[1000 % 256 :]
    with (tmp_path / "logs" / "large.mcap").open("wb") as large:
        large.truncate(5 << 30)
    assert _ftp(bench, ftp.OPEN_READ, b"/logs/large.mcap\0")[0][3] == b"\xff" * 4, "more than 32 bits name"
    for path in b"/logs/../secret /secret /etcx/run.mcap /logs/link /logs /logs/none \xff\xfe /etc/passwd".split():
        assert _ftp(bench, ftp.OPEN_READ, path + b"\0")[0][3] == bytes((ftp.NOT_FOUND,)), path


def test_a_long_folder_is_listed_in_parts_and_a_file_read_in_pieces_that_fit(tmp_path: Path) -> None:
    names = [f"{number:03}_{'x' * 50}.mcap" for number in range(11)]
    for name in names:
        (tmp_path / name).write_bytes(bytes(600))
    bench, found = Bench(folder=str(tmp_path)), list[str]()
    while True:
        ((kind, _, _, data),) = _ftp(bench, ftp.LIST, b"/logs\0", offset=len(found))
        if kind == ftp.NAK:
            break
        parts = data.decode().split("\0")[:-1]
        assert len(parts) == 3 or len(found) > 6
        found += parts
    assert (found, data) == ([f"F{name}\t600" for name in names], bytes((ftp.END_OF_FILE,)))
    _ftp(bench, ftp.OPEN_READ, f"/logs/{names[0]}\0".encode())
    sizes = [len(_ftp(bench, ftp.READ, offset=at, size=size)[0][3]) for at, size in ((0, 0), (0, 9), (595, 100))]
    assert sizes == [ftp.MAX_DATA, 9, 5]
    assert _ftp(bench, ftp.READ, size=240)[0][3] == bytes((ftp.BAD_SIZE,))
    pieces = _ftp(bench, ftp.BURST, offset=100, size=200)
    assert [(kind, offset, len(data)) for kind, _, offset, data in pieces] == [
        (ftp.ACK, 100, 200), (ftp.ACK, 300, 200), (ftp.ACK, 500, 100), (ftp.NAK, 100, 1)
    ]  # fmt: skip
    assert [kind for kind, *_ in _ftp(bench, ftp.BURST, size=1)] == [ftp.ACK] * ftp.BURST_AT_ONCE


@pytest.mark.parametrize("opcode", [0, ftp.ACK, ftp.NAK])
def test_answers_of_others_get_no_answer(opcode: int) -> None:
    assert _ftp(Bench(), opcode, b"/logs\0") == []


@pytest.mark.parametrize("opcode", [*ftp.WRITING, 77])
def test_unsupported_file_operations_are_refused_at_once(opcode: int) -> None:
    bench = Bench()
    assert [kind for kind, *_ in _ftp(bench, opcode, b"/logs/new\0")] == [ftp.NAK]


def test_the_oldest_file_session_of_a_peer_makes_room() -> None:
    bench = Bench()
    first, other = bench.partner, bench.add_partner(254)
    bench.partner = other
    assert _ftp(bench, ftp.OPEN_READ, b"@PARAM/param.pck\0", session=40)[0][0] == ftp.ACK
    bench.partner = first
    opened = [_ftp(bench, ftp.OPEN_READ, b"@PARAM/param.pck\0", session=n)[0] for n in range(40, 49)]
    assert [session for _, session, _, _ in opened] == list(range(40, 49))  # MAVProxy numbers its sessions itself
    assert [_ftp(bench, ftp.READ, session=n, size=10)[0][0] for n in (40, 41, 48)] == [ftp.NAK, ftp.ACK, ftp.ACK]
    bench.partner = other
    assert _ftp(bench, ftp.READ, session=40, size=10)[0][0] == ftp.ACK, "another peer has sessions of its own"
    server = ftp.FtpServer("", bench.table)
    opening = ftp.HEADER.pack(0, 0, ftp.OPEN_READ, 17, 0, 0, 0) + b"@PARAM/param.pck\0"
    for number in range(ftp.MOST_SESSIONS + 5):
        server.handle(opening, (number, 255, 190))
    assert len(server._sessions) == ftp.MOST_SESSIONS, "peers that come and go leave no more"


def test_the_log_protocol_which_has_no_names_refers_to_files(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(bytes(1000))
    bench = Bench(folder=str(tmp_path))
    bench.partner.send(dialect.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    (entry,) = bench.partner.take_messages("LOG_ENTRY")
    assert not any(getattr(entry, field) for field in entry.fieldnames)
    bench.run(0.1)
    assert "/logs" in bench.partner.texts()
    assert _ftp(bench, ftp.LIST, b"@MAV_LOG\0")[0][3] == b"Fa.mcap\t1000\0"


def test_message_intervals_can_be_set() -> None:
    bench = Bench()
    number = dialect.MAVLINK_MSG_ID_ATTITUDE
    command = bench.partner.command
    assert command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, number, 200_000) == ACCEPTED
    bench.run(2.0)
    assert len(bench.partner.take_messages("ATTITUDE")) == pytest.approx(10, abs=1)
    assert command(dialect.MAV_CMD_GET_MESSAGE_INTERVAL, number) == ACCEPTED
    assert bench.partner.take_messages("MESSAGE_INTERVAL")[0].interval_us == 200_000
    assert command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 9999, 1000) == DENIED
    assert command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, number, float("nan")) == DENIED


def test_message_groups_and_single_messages_can_be_requested() -> None:
    bench = Bench()
    bench.partner.send(dialect.MAVLink_request_data_stream_message(1, 1, dialect.MAV_DATA_STREAM_ALL, 0, 0))
    bench.run(1.0)
    bench.partner.received.clear()
    bench.partner.send(dialect.MAVLink_request_data_stream_message(1, 1, dialect.MAV_DATA_STREAM_EXTRA2, 10, 1))
    bench.run(1.0)
    assert 9 <= len(bench.partner.take_messages("VFR_HUD")) <= 11
    assert bench.partner.take_messages("ATTITUDE") == []
    assert bench.partner.command(dialect.MAV_CMD_REQUEST_MESSAGE, 30) == ACCEPTED
    assert len(bench.partner.take_messages("ATTITUDE")) == 1
    assert bench.partner.command(dialect.MAV_CMD_REQUEST_MESSAGE, 148) == ACCEPTED
    (version,) = bench.partner.take_messages("AUTOPILOT_VERSION")
    assert version.capabilities == 0b10_0010_0001_1110_1110, "float and whole items, files, targets, MAVLink 2"
    assert bytes(version.flight_custom_version) == __version__.encode().ljust(8, b"\0")
    others = {name for name in version.fieldnames if getattr(version, name) not in (0, [0] * 8, [0] * 18)}
    assert others == {"capabilities", "flight_sw_version", "flight_custom_version", "uid"}
    assert bench.partner.command(dialect.MAV_CMD_REQUEST_MESSAGE, 147) == UNSUPPORTED  # it has no battery


def test_timesync_and_ping_requests_are_answered() -> None:
    bench = Bench()
    bench.partner.send(dialect.MAVLink_timesync_message(0, 1234))
    (answer,) = bench.partner.take_messages("TIMESYNC")
    assert (answer.ts1, answer.tc1) == (1234, bench.now)
    bench.partner.send(dialect.MAVLink_timesync_message(5, 1234))
    assert bench.partner.take_messages("TIMESYNC") == []
    bench.partner.send(dialect.MAVLink_ping_message(1, 2, 0, 0))
    assert bench.partner.take_messages("PING")[0].target_system == 255


def test_an_observer_cannot_change_anything() -> None:
    bench = Bench()
    guest = bench.add_partner(system=250, may_command=False)
    assert guest.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1) == DENIED
    assert guest.command(dialect.MAV_CMD_DO_SET_MODE, 1, 2) == DENIED
    assert guest.peer.denied == 2
    guest.send(dialect.MAVLink_set_mode_message(1, 1, 2))
    guest.send(dialect.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", 3.0, 9))
    assert guest.take_messages("PARAM_VALUE")[0].param_value == 50.0
    assert upload_mission(guest, [HOME_ROW]) == dialect.MAV_MISSION_DENIED
    bench.arm(Mode.GUIDED)
    before = bench.core.pilot.target
    guest.sticks(x=1000)
    guest.send(dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0b110111111000, *[9.0] * 11))
    guest.send(dialect.MAVLink_set_gps_global_origin_message(1, 1, 1, 1))
    bench.run(0.2)
    assert bench.core.pilot.target == before
    assert bench.core.pilot.joystick.stale == 0
    assert guest.texts().count("may only look") == 1
    assert guest.command(dialect.MAV_CMD_REQUEST_MESSAGE, 30) == ACCEPTED
    guest.send(dialect.MAVLink_param_request_list_message(1, 1))
    bench.run(0.2)
    assert len(guest.take_messages("PARAM_VALUE")) == len(bench.table.names())


def test_a_reset_ends_the_file_sessions_of_its_sender_only(tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(b"one flight")
    server = ftp.FtpServer(str(tmp_path), Bench().table)

    def ask(partner: int, number: int, opcode: int, data: bytes = b"") -> int:
        request = ftp.HEADER.pack(number, 1, opcode, len(data), 0, 0, 0) + data
        (reply,) = server.handle(request, (partner, 255, 190))
        return int(reply[3])

    assert [ask(partner, 1, ftp.OPEN_READ, b"/logs/log") for partner in (1, 2)] == [ftp.ACK] * 2
    assert ask(1, 2, ftp.RESET) == ftp.ACK
    assert [ask(partner, 3, ftp.READ) for partner in (1, 2)] == [ftp.NAK, ftp.ACK]
