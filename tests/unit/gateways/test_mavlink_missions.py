"""Missions of the MAVLink gateway: uploaded, read back, flown."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink.flight.mission_flight import COMPLETE
from hil.gateways.mavlink.flight.modes import Mode
from hil.scenario.mavlink_records import Mavlink
from tests.support.clients.mavlink_missions import ACCEPTED, HOME_ROW, upload_mission
from tests.support.clients.mavlink_vehicle import Bench

LOCAL = dialect.MAV_FRAME_LOCAL_NED


def test_a_mission_is_uploaded_and_downloaded_equal() -> None:
    bench = Bench()
    rows = [HOME_ROW, (LOCAL, 16, 5.0, 0.0, 3.0), (LOCAL, 16, 5.0, -5.0, 3.0, 2.0), (LOCAL, 20, 0.0, 0.0, 0.0)]
    assert upload_mission(bench.partner, rows) == dialect.MAV_MISSION_ACCEPTED
    bench.partner.send(dialect.MAVLink_mission_request_list_message(1, 1, 0))
    assert bench.partner.take_messages("MISSION_COUNT")[0].count == 4
    for index in range(4):
        bench.partner.send(dialect.MAVLink_mission_request_int_message(1, 1, index, 0))
    items = bench.partner.take_messages("MISSION_ITEM_INT")
    assert [item.seq for item in items] == [0, 1, 2, 3]
    assert (items[2].x, items[2].y, items[2].z, items[2].param1) == (50_000, -50_000, 3.0, 2.0)
    home = {name: value for name, value in items[0].to_dict().items() if value and name != "mavpackettype"}
    wanted = {"x": round(45e7), "y": round(10e7), "command": 16, "autocontinue": 1}
    assert home == wanted | {"target_system": 255, "target_component": 190}, "whatever the upload had there"
    bench.partner.send(dialect.MAVLink_mission_request_message(1, 1, 1, 0))
    assert bench.partner.take_messages("MISSION_ITEM")[0].x == pytest.approx(5.0)


def test_item_zero_is_a_waypoint_for_a_generic_autopilot() -> None:
    bench = Bench(Mavlink(autopilot="generic"))
    assert upload_mission(bench.partner, [(LOCAL, 16, 5.0, 0.0, 3.0)]) == dialect.MAV_MISSION_ACCEPTED
    assert bench.core.flight.current == 0
    assert bench.partner.command(dialect.MAV_CMD_MISSION_START) == ACCEPTED


def test_global_positions_need_an_origin() -> None:
    bench = Bench(origin=None)
    rows = [HOME_ROW, (6, 16, 45e3, 10e3, -2.0)]
    assert upload_mission(bench.partner, rows) == dialect.MAV_MISSION_INVALID_PARAM5_X
    bench.partner.send(dialect.MAVLink_set_gps_global_origin_message(1, round(45e7), round(10e7), 0))
    assert upload_mission(bench.partner, rows) == dialect.MAV_MISSION_ACCEPTED


def test_an_item_that_skips_a_number_is_not_taken_for_the_next_one() -> None:
    bench = Bench()
    send, rows = bench.partner.send, {1: 50_000, 2: 90_000}
    send(dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    for index in (0, 2, 1, 1, 2, 2):
        north = rows.get(index, 0)
        send(dialect.MAVLink_mission_item_int_message(1, 1, index, LOCAL, 16, 0, 1, 0, 0, 0, 0, north, 0, 3.0))
    accepted = [ack.type for ack in bench.partner.take_messages("MISSION_ACK")]
    assert accepted == 2 * [dialect.MAV_MISSION_ACCEPTED], "the last item came again, as its answer was lost"
    for index, north in rows.items():
        send(dialect.MAVLink_mission_request_int_message(1, 1, index, 0))
        assert bench.partner.take_messages("MISSION_ITEM_INT")[0].x == north


def test_a_mission_is_flown_item_by_item() -> None:
    bench = Bench()
    rows = [HOME_ROW, (LOCAL, 16, 1.0, 0.0, 1.5), (LOCAL, 201, 0.0, 0.0, 0.0), (LOCAL, 20, 0.0, 0.0, 0.0)]
    assert upload_mission(bench.partner, rows) == dialect.MAV_MISSION_ACCEPTED
    bench.arm(Mode.AUTO)
    bench.run(20.0)
    reached = [message.seq for message in bench.partner.take_messages("MISSION_ITEM_REACHED")]
    assert reached == [1, 3]
    assert bench.core.flight.status == COMPLETE
    assert abs(bench.vehicle.north) < 0.6
    assert abs(bench.vehicle.depth - 0.2) < 0.5
    assert "mission complete" in bench.partner.texts()
    current = bench.partner.take_messages("MISSION_CURRENT")[-1]
    assert (current.mission_state, current.seq, current.total) == (COMPLETE, 3, 3)


def test_auto_mode_needs_a_mission() -> None:
    bench = Bench()
    assert bench.partner.command(dialect.MAV_CMD_DO_SET_MODE, 1, Mode.AUTO) != ACCEPTED
    bench.run(0.1)
    assert "no mission" in bench.partner.texts()
