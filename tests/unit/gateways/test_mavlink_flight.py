"""The exchange and the flight of missions, guard by guard: what ends an item, what begins again, who is refused."""

from math import cos, inf, nan, pi, sin
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.client.samples import State
from hil.common.clock import NS_PER_S
from hil.gateways.mavlink.flight.mission_flight import ACTIVE, COMPLETE, IDLE, PAUSED, MissionFlight
from hil.gateways.mavlink.flight.mission_items import Item
from hil.gateways.mavlink.flight.modes import Mode
from hil.gateways.mavlink.protocols.missions import RETRIES, RETRY_NS
from tests.support.clients.mavlink_missions import HOME_ROW, upload_mission
from tests.support.clients.mavlink_vehicle import Bench

LOCAL, NO_MISSION = dialect.MAV_FRAME_LOCAL_NED, dialect.MISSION_STATE_NO_MISSION
GO, LOITER, HOME, LAND, DELAY, SPEED, JUMP = 16, 17, 20, 21, 93, 178, 177
TABLE: Any = {"WPNAV_RADIUS": 2.0, "SURFACE_DEPTH": -0.2}
ACCEPTED, INVALID, UNSUPPORTED, DENIED, NOT_ITS_TURN = (
    dialect.MAV_MISSION_ACCEPTED, dialect.MAV_MISSION_INVALID, dialect.MAV_MISSION_UNSUPPORTED,
    dialect.MAV_MISSION_DENIED, dialect.MAV_MISSION_INVALID_SEQUENCE,
)  # fmt: skip


def row(command: int, *params: float, place: tuple[float, float, float] = (9.0, 0.0, 3.0)) -> Item:
    north, east, down = place
    four: Any = (*params, *[0.0] * (4 - len(params)))
    return Item(LOCAL, command, four, round(north * 1e4), round(east * 1e4), down)


def flight_of(*items: Item) -> MissionFlight:
    """Return the flight over items from number 1 on; number 0 is home."""
    flight = MissionFlight(TABLE, lambda: None, lambda: (1.0, 2.0, 0.0), 1)
    flight.replace([row(GO), *items])
    return flight


def begun(*items: Item) -> MissionFlight:
    flight = flight_of(*items)
    assert flight.begin() == ""
    return flight


def at(north: float = 0.0, east: float = 0.0, down: float = 3.0, heading: float = 0.0) -> State:
    return State(0, (north, east, down), (cos(0.5 * heading), 0.0, 0.0, sin(0.5 * heading)), (0.0,) * 6)


END = row(GO, place=(99.0, 0.0, 3.0))  # out of reach: what is under way once an item is done
NEXT = (99.0, 0.0, 3.0)


@pytest.mark.parametrize(
    ("item", "north", "seconds", "done"),
    [
        (row(GO), 6.9, 0.0, False), (row(GO), 7.1, 0.0, True),  # within WPNAV_RADIUS
        (row(GO, 0.0, 5.0), 4.1, 0.0, True), (row(GO, 0.0, 5.0), 3.9, 0.0, False),  # within its own radius
        (row(GO, 0.0, 0.5), 8.4, 0.0, False), (row(GO, 0.0, 0.5), 8.6, 0.0, True),
        (row(GO, 0.0, -1.0), 6.9, 0.0, False), (row(GO, 0.0, -1.0), 7.1, 0.0, True),
        (row(GO, 0.0, nan), 7.1, 0.0, True),
        (row(GO, 0.0, 500.0), -90.0, 0.0, True), (row(GO, 0.0, 500.0), -92.0, 0.0, False),  # 100 m at most
        (row(GO, 4.0), 9.0, 3.9, False), (row(GO, 4.0), 9.0, 4.1, True), (row(GO, -4.0), 9.0, 0.0, True),
        (row(GO, nan), 9.0, 0.0, True), (row(19, 4.0, 5.0), 4.1, 4.1, False), (row(19, 4.0), 9.0, 4.1, True),
        (row(LOITER), 9.0, 1e6, False), (row(82), 7.1, 0.0, True),
    ],
)  # fmt: skip
def test_an_item_is_done_within_its_radius_and_after_its_time(
    item: Item, north: float, seconds: float, done: bool
) -> None:
    flight = begun(item, END)
    flight.step(at(north), 0)
    target = flight.step(at(north), round(seconds * NS_PER_S))
    assert target
    assert (flight.current, target.position == NEXT) == (1 + done, done)
    assert flight.reached == [1] * (done or (seconds > 0.0 and item.command in (GO, LOITER)))


@pytest.mark.parametrize(("speed", "kept"), [(1.0, 1.0), (5.0, 5.0), (5.1, None), (0.0, None), (-1.0, None)])
def test_a_speed_lasts_until_the_mission_begins_again(speed: float, kept: float | None) -> None:
    flight = begun(row(SPEED, 1.0, speed), row(GO, 5.0))
    for now in (0, NS_PER_S):  # on the way, and while it waits there
        target = flight.step(at(9.0 if now else 0.0), now)
        assert target
        assert target.speed == kept
    flight.step(at(9.0), 9 * NS_PER_S)
    assert (flight.status, flight.current) == (COMPLETE, 3)
    flight.restart()
    assert (flight._speed, flight.current) == (None, 1)


@pytest.mark.parametrize(("command", "place"), [(HOME, (1.0, 2.0, 0.2)), (LAND, (5.0, 6.0, 0.2))])
def test_the_ways_home_and_up_end_below_the_surface(command: int, place: tuple[float, ...]) -> None:
    flight = begun(row(command, 5.0, 9.0), END)
    target = flight.step(at(5.0, 6.0, 4.0), 0)
    assert target
    assert target.position == place
    flight.step(at(*place[:2], 2.3), 1)
    assert flight.current == 1
    flight.step(at(*place[:2], 2.1), 2)
    assert flight.current == 2


@pytest.mark.parametrize(("yaw", "heading"), [(90.0, 0.5 * pi), (0.0, None), (nan, None)])
def test_a_waypoint_has_a_heading_unless_it_is_zero_or_nan(yaw: float, heading: float | None) -> None:
    flight = begun(row(GO, 0.0, 0.0, 0.0, yaw))
    target = flight.step(at(), 0)
    assert target
    assert target.heading == heading
    done = flight.step(at(9.0, heading=0.4), 1)
    assert done
    assert (flight.status, done.position) == (COMPLETE, (9.0, 0.0, 3.0)), "it stays at the last place"
    assert done.heading == (pytest.approx(0.4) if heading is None else heading)


def test_another_item_is_selected_within_the_mission() -> None:
    flight = flight_of(row(GO), row(GO, 4.0))
    assert [flight.select(index) for index in (-1, 3, 0)] == [False, False, True]
    assert (flight.current, flight.status) == (1, IDLE), "item 0 is home"
    flight = begun(row(GO, 4.0), END)
    flight.step(at(9.0), 0)
    assert flight.select(1)
    flight.step(at(9.0), 3 * NS_PER_S)
    flight.step(at(9.0), 6 * NS_PER_S)
    assert flight.current == 1, "its time begins again"
    flight.step(at(9.0), 10 * NS_PER_S)
    assert (flight.current, flight.reached) == (2, [1, 1])
    for status in (COMPLETE, PAUSED):
        flight.status = status
        assert flight.select(1)
        assert flight.status == ACTIVE


def test_a_mission_begins_again_when_it_was_complete() -> None:
    assert flight_of().begin() == "there is no mission"
    assert (flight_of().status, flight_of(row(GO)).status) == (NO_MISSION, IDLE)
    flight = begun(row(GO, 4.0))
    flight.step(at(9.0), 0)
    flight.begin()
    flight.step(at(9.0), 5 * NS_PER_S)
    assert flight.current == 1, "the time of the item begins again"
    flight.step(at(9.0), 10 * NS_PER_S)
    assert (flight.status, flight.texts) == (COMPLETE, [(6, "mission complete")])
    flight.begin()
    assert (flight.status, flight.current) == (ACTIVE, 1)


def test_a_place_on_the_earth_without_an_origin_pauses_the_mission() -> None:
    flight = begun(Item(dialect.MAV_FRAME_GLOBAL, GO, (0.0,) * 4, 450_000_000, 100_000_000, -3.0))
    target = flight.step(at(4.0), 0)
    assert target
    assert (flight.status, target.position) == (PAUSED, (4.0, 0.0, 3.0))
    assert [severity for severity, _ in flight.texts] == [3], "it is said once"


def test_idle_items_take_no_time() -> None:
    flight = begun(row(GO), row(201), row(SPEED, 1.0, 2.0), END)
    target = flight.step(at(9.0), 0)
    assert target
    assert (flight.reached, flight.current, target.speed) == ([1], 4, 2.0)


# --- the exchange with a ground station


def ack_of(bench: Bench, message: Any, partner: Any = None) -> tuple[int, int] | None:
    """Send a message; return result and mission type of the answer."""
    partner = partner or bench.partner
    partner.take_messages("MISSION_ACK")
    partner.send(message)
    acks = [(ack.type, ack.mission_type) for ack in partner.take_messages("MISSION_ACK")]
    return acks[-1] if acks else None


def item(index: int, north: int = 50_000, kind: int = 0, down: float = 3.0) -> Any:
    return dialect.MAVLink_mission_item_int_message(
        1, 1, index, LOCAL, GO, 0, 1, 0, 0, 0, 0, north, 0, down, mission_type=kind
    )


def count_of(count: int, kind: int = 0) -> Any:
    return dialect.MAVLink_mission_count_message(1, 1, count, kind)


def uploaded() -> Bench:
    bench = Bench()
    assert upload_mission(bench.partner, [HOME_ROW, (LOCAL, GO, 5.0, 0.0, 3.0)]) == ACCEPTED
    return bench


@pytest.mark.parametrize(
    ("kind", "count", "of_count", "of_clear", "left"),
    [(0, 2, None, ACCEPTED, 0), (1, 0, UNSUPPORTED, ACCEPTED, 2), (2, 0, UNSUPPORTED, ACCEPTED, 2),
     (7, None, UNSUPPORTED, UNSUPPORTED, 2), (255, None, UNSUPPORTED, ACCEPTED, 0)],
)  # fmt: skip
def test_fences_and_rally_points_are_empty_and_leave_the_mission_alone(
    kind: int, count: int | None, of_count: int | None, of_clear: int, left: int
) -> None:
    bench = uploaded()
    refused = ack_of(bench, dialect.MAVLink_mission_request_list_message(1, 1, kind))
    counts = [(found.count, found.mission_type) for found in bench.partner.take_messages("MISSION_COUNT")]
    assert (counts, refused) == (([(count, kind)], None) if count is not None else ([], (UNSUPPORTED, kind)))
    if kind:
        assert ack_of(bench, dialect.MAVLink_mission_request_int_message(1, 1, 1, kind)) == (NOT_ITS_TURN, kind)
        assert ack_of(bench, count_of(2, kind)) == (of_count, kind)
        assert ack_of(bench, count_of(0, kind)) == (ACCEPTED if count == 0 else UNSUPPORTED, kind)
    assert ack_of(bench, dialect.MAVLink_mission_clear_all_message(1, 1, kind)) == (of_clear, kind)
    assert bench.core.flight.total == left
    assert ack_of(bench, dialect.MAVLink_mission_request_message(1, 1, 9, 0)) == (NOT_ITS_TURN, 0)


def test_a_failed_upload_leaves_the_mission_and_makes_room() -> None:
    bench = uploaded()
    other = bench.add_partner(254)
    bench.partner.send(count_of(3))
    assert ack_of(bench, count_of(2), other) == (DENIED, 0)
    assert ack_of(bench, item(0), other) == (NOT_ITS_TURN, 0), "it is another's upload"
    assert ack_of(bench, item(0, kind=1)) == (NOT_ITS_TURN, 1)
    assert ack_of(bench, item(0)) is None
    assert ack_of(bench, item(1, down=nan)) == (INVALID, 0)
    assert ack_of(bench, item(1, north=77)) == (NOT_ITS_TURN, 0), "there is no upload any more"
    assert [one.x for one in bench.core.missions.items[1:]] == [50_000]
    assert upload_mission(other, [HOME_ROW]) == ACCEPTED


def test_a_new_count_or_a_clearing_ends_the_upload() -> None:
    bench = uploaded()
    bench.partner.send(count_of(3))
    bench.partner.send(item(0))
    bench.partner.send(count_of(2))
    assert [ack_of(bench, item(index, north=10_000)) for index in (0, 1)] == [None, (ACCEPTED, 0)]
    for end in (count_of(0), dialect.MAVLink_mission_clear_all_message(1, 1, 0)):
        bench.partner.send(count_of(3))
        assert ack_of(bench, end) == (ACCEPTED, 0)
        assert ack_of(bench, item(0)) == (NOT_ITS_TURN, 0)
        assert (bench.core.flight.total, bench.core.flight.status) == (0, NO_MISSION)


@pytest.mark.parametrize(
    ("place", "result"),
    [((2e5, 0.0), ACCEPTED), ((-2.2e5, 0.0), INVALID), ((0.0, 2.2e5), INVALID), ((nan, 0.0), INVALID)],
)
def test_an_item_of_the_old_form_fits_into_the_numbers_of_the_new_one(place: tuple[float, float], result: int) -> None:
    bench = Bench()
    bench.partner.send(count_of(2))
    bench.partner.send(item(0))
    old = dialect.MAVLink_mission_item_message(1, 1, 1, LOCAL, GO, 0, 1, 0, 0, 0, 0, *place, 3.0)
    assert ack_of(bench, old) == (result, 0)


@pytest.mark.parametrize(("late", "other", "result"), [(1, 50_000, ACCEPTED), (0, 50_000, 13), (1, 40_000, 13)])
def test_only_the_last_item_as_it_was_is_acknowledged_again(late: int, other: int, result: int) -> None:
    assert ack_of(uploaded(), item(late, north=other)) == (result, 0)


def test_an_upload_ends_after_its_attempts_and_each_item_gives_it_all_of_them_again() -> None:
    bench = Bench()
    patience_s = RETRIES * RETRY_NS / NS_PER_S
    bench.partner.send(count_of(3))
    for index in range(2):
        bench.run(patience_s + 0.1)
        for kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):  # scripts know one of them
            assert [request.seq for request in bench.partner.take_messages(kind)] in ([index] * 4, [index] * 5)
        bench.partner.send(item(index))
    assert bench.partner.take_messages("MISSION_ACK") == []
    bench.run(patience_s + 0.3)
    assert bench.partner.take_messages("MISSION_ACK") == []
    bench.run(0.3)
    assert [ack.type for ack in bench.partner.take_messages("MISSION_ACK")] == [dialect.MAV_MISSION_OPERATION_CANCELLED]
    bench.run(patience_s)
    assert bench.partner.take_messages("MISSION_ACK") == [], "it has ended"
    bench.partner.send(count_of(3))
    bench.dispatcher.peers.clear()
    bench.run(0.5)  # nobody is there to ask


@pytest.mark.parametrize(
    ("frame", "north", "z", "result"),
    [(10, 0.0, 0.0, dialect.MAV_MISSION_UNSUPPORTED_FRAME), (6, 99e3, 0.0, 10), (6, 45e3, 0.0, ACCEPTED),
     (LOCAL, 5.0, 11_000.0, ACCEPTED), (LOCAL, 5.0, 11_001.0, 10), (LOCAL, 5.0, -11_001.0, 10)],
)  # fmt: skip
def test_a_waypoint_has_a_frame_and_a_place_that_can_be_reached(
    frame: int, north: float, z: float, result: int
) -> None:
    assert upload_mission(Bench().partner, [HOME_ROW, (frame, GO, north, 10e3, z)]) == result


def test_missions_of_500_items_are_taken_and_home_may_be_anywhere() -> None:
    bench = Bench()
    rows = [(6, GO, 99e3, 0.0, 0.0), *[(LOCAL, GO, 5.0, 0.0, 3.0)] * 499]
    assert upload_mission(bench.partner, rows) == ACCEPTED
    assert ack_of(bench, count_of(501)) == (dialect.MAV_MISSION_NO_SPACE, 0)


@pytest.mark.parametrize(
    ("command", "params", "result"),
    [
        (JUMP, (0.0, 1.0), UNSUPPORTED), (SPEED, (0.0, 1.0), ACCEPTED),
        (SPEED, (0.0, inf), 7), (DELAY, (5.0,), UNSUPPORTED), (22, (), ACCEPTED), (2501, (), ACCEPTED),
        (530, (), ACCEPTED), (18, (), UNSUPPORTED),
        (535, (), UNSUPPORTED), (23, (), UNSUPPORTED), (240, (), ACCEPTED), (241, (), UNSUPPORTED),
    ],
)  # fmt: skip
def test_an_item_is_validated_when_it_is_uploaded(command: int, params: tuple[float, ...], result: int) -> None:
    rows: list[tuple[Any, ...]] = [HOME_ROW, (LOCAL, command, 0.0, 0.0, 0.0, *params), (LOCAL, GO, 5.0, 0.0, 3.0)]
    assert upload_mission(Bench().partner, rows) == result


def test_the_mission_starts_at_the_item_that_the_command_names_or_goes_on() -> None:
    bench, start = uploaded(), dialect.MAV_CMD_MISSION_START
    assert upload_mission(bench.partner, [HOME_ROW, *[(LOCAL, GO, 5.0, 0.0, 3.0)] * 3]) == ACCEPTED
    found = [(bench.partner.command(start, first), bench.core.flight.current) for first in (4.0, 2.0, 0.0, nan, -1.0)]
    assert found == [(dialect.MAV_RESULT_DENIED, 1), *[(dialect.MAV_RESULT_ACCEPTED, 2)] * 4]
    assert bench.core.pilot.mode == Mode.AUTO
    for index, current in ((3, [3]), (4, [])):
        bench.partner.take_messages("MISSION_CURRENT")
        bench.partner.send(dialect.MAVLink_mission_set_current_message(1, 1, index))
        assert [message.seq for message in bench.partner.take_messages("MISSION_CURRENT")] == current
    assert bench.partner.command(dialect.MAV_CMD_DO_SET_MISSION_CURRENT, 2) == dialect.MAV_RESULT_ACCEPTED
