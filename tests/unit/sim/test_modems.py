"""Acoustic modems against cases worked out by hand."""

from math import exp, hypot, log10

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.scenario.modem import ModemReport, encode_report
from sim.environment.ocean import Profile
from sim.environment.seawater.sound_rays import SoundRays
from sim.environment.seawater.water_column import WaterColumn
from sim.modems.acoustic import NS, AcousticChannel, AcousticModem, Packet
from sim.modems.sound import ambient_noise, paths, thorp_absorption, transmission_loss
from sim.modems.usbl import UsblFix, UsblRounds
from sim.sensors.error import ErrorModel

EXACT = AcousticModem(range_error=ErrorModel())
REPORT = encode_report(ModemReport((0.0, 0.0, 0.0), (0.0, 0.0), 0))
TWO = {"a": (0.0, 0.0, 10.0), "b": (300.0, 400.0, 10.0)}


SLOWER_BELOW = WaterColumn(Profile((0.0, 200.0), (1025.0, 1027.0), (1520.0, 1480.0)), 9.81)


def test_a_message_travels_along_the_refracted_ray() -> None:
    positions = {"a": (0.0, 0.0, 60.0), "b": (600.0, 0.0, 90.0)}
    ray = SoundRays((0.0, 200.0), (1520.0, 1480.0)).between(600.0, 60.0, 90.0)
    assert ray is not None
    channel = AcousticChannel(EXACT, 150.0, seed=1, column=SLOWER_BELOW)
    through = channel.send(0, "a", b"x", positions)
    (packet,) = run(channel)
    assert packet.received_ns == through + round(ray.time * NS)
    assert packet.distance == pytest.approx(ray.time * 1500.0, abs=1e-5)


@pytest.mark.parametrize(("bounces", "result"), [(0, "shadowed"), (1, "delivered")])
def test_only_a_reflection_reaches_a_shadow_zone(bounces: int, result: str) -> None:
    """The modems are both 3 m deep, 550 m apart, under sound that bends down."""
    positions = {"a": (0.0, 0.0, 3.0), "b": (550.0, 0.0, 3.0)}
    model = EXACT._replace(bounces=bounces, source_level=190.0)
    channel = AcousticChannel(model, 100.0, seed=1, column=SLOWER_BELOW)
    channel.send(0, "a", b"x", positions)
    assert len(run(channel)) == bounces
    assert channel.counts == {"sent": 1, result: 1}


def run(channel: AcousticChannel, until_s: float = 10.0) -> list[Packet]:
    return channel.receive(round(until_s * NS))


def test_thorp_and_wenz_have_the_values_worked_out_by_hand() -> None:
    # f = 10 kHz: 0.11*100/101 + 44*100/4200 + 0.0275 + 0.003
    assert thorp_absorption(10_000.0) * 1000.0 == pytest.approx(0.10891 + 1.04762 + 0.0275 + 0.003, abs=1e-4)
    assert transmission_loss(1000.0, 10_000.0, 2.0) == pytest.approx(60.0 + 1.18703 * 0.999, abs=1e-3)
    # 10 kHz, wind 4 m/s, shipping 0.5: 10^-1.3 + 10^(40+26-60.078)/10 + 10^(50+15+20-40.680)/10 + 10^0.5
    parts = 10**-1.3 + 10 ** ((66.0 - 60.0 * log10(10.03)) / 10) + 10 ** ((85.0 - 40.0 * log10(10.4)) / 10) + 10**0.5
    assert ambient_noise(10_000.0, 4.0, 0.5) == pytest.approx(10.0 * log10(parts))


def test_a_message_takes_its_travel_time_and_airtime() -> None:
    channel = AcousticChannel(EXACT, 50.0, seed=1)
    through = channel.send(0, "a", b"x" * 16, TWO)
    assert through == round((0.03 + 128 / 640) * NS)
    arrives = round(500.0 / 1500.0 * NS) + through
    assert channel.receive(arrives - 1) == []
    (packet,) = channel.receive(arrives)
    assert (packet.sender, packet.receiver, packet.payload) == ("a", "b", b"x" * 16)
    assert (packet.sent_ns, packet.received_ns) == (0, arrives)
    assert packet.distance == pytest.approx(500.0, abs=1e-6)
    assert channel.receive(arrives + NS) == []
    assert channel.counts == {"sent": 1, "delivered": 1}


def test_signal_to_noise_follows_the_sonar_equation() -> None:
    channel = AcousticChannel(EXACT, 50.0, seed=1)
    channel.send(0, "a", b"x", TWO)
    (packet,) = run(channel)
    noise = ambient_noise(28_000.0, 5.0, 0.5) + 10.0 * log10(8000.0)
    assert packet.snr == pytest.approx(168.0 - transmission_loss(500.0, 28_000.0, 1.5) - noise)


def test_a_wrong_speed_of_sound_scales_the_range() -> None:
    column = WaterColumn(Profile((0.0, 100.0), (1000.0, 1000.0), (1480.0, 1480.0)), 9.81)
    channel = AcousticChannel(EXACT, 50.0, seed=1, column=column)
    channel.send(0, "a", b"x", TWO)
    (packet,) = run(channel)
    assert packet.distance == pytest.approx(500.0 * 1500.0 / 1480.0, rel=1e-6)


@pytest.mark.parametrize("sends_at", [0.2, 0.4])
def test_a_modem_that_sends_or_begins_to_cannot_receive(sends_at: float) -> None:
    """The message from a comes at 0.33 s, and is through at 0.56 s."""
    channel = AcousticChannel(EXACT, 50.0, seed=1)
    channel.send(0, "a", b"x" * 16, TWO)
    channel.receive(round((sends_at - 0.05) * NS))
    channel.send(round(sends_at * NS), "b", b"y" * 16, TWO)
    assert [packet.receiver for packet in run(channel)] == ["a"]
    assert channel.counts["deaf"] == 1


def test_one_message_at_a_time_is_sent_and_too_long_ones_refused() -> None:
    channel = AcousticChannel(EXACT, 50.0, seed=1)
    assert channel.send(0, "a", b"x" * 64, TWO)
    assert channel.send(1, "a", b"x", TWO) == 0
    assert channel.send(NS, "a", b"x" * 65, TWO) == 0
    assert (channel.counts["busy"], channel.counts["too_long"]) == (1, 1)


def test_the_first_of_two_colliding_messages_is_received_with_interference() -> None:
    positions = {"near": (0.0, 0.0, 5.0), "ear": (30.0, 0.0, 5.0), "far": (900.0, 0.0, 5.0)}
    channel = AcousticChannel(EXACT, 50.0, seed=1)
    channel.send(0, "near", b"x" * 16, positions)
    channel.send(1, "far", b"y" * 2, positions)  # reaches the ear at 0.58 s; near's is over at 0.25 s
    assert [(p.sender, p.receiver) for p in run(channel, 0.3)] == [("near", "ear")]
    alone = AcousticChannel(EXACT, 50.0, seed=1)
    alone.send(0, "near", b"x" * 16, positions | {"far": (150.0, 0.0, 5.0)})
    alone.send(1, "far", b"y" * 16, positions | {"far": (150.0, 0.0, 5.0)})  # at 0.08 s, over near's
    received = [p for p in run(alone) if p.receiver == "ear"]
    assert [p.sender for p in received] == ["near"]
    assert alone.counts["collided"] == 1
    # 120 m against 30 m: 15 log10(4) = 9 dB less, plus absorption; all but 0.06 s of the 0.23 s
    assert 8.0 < received[0].snr < 12.0


def test_a_longer_message_that_came_first_occupies_the_receiver() -> None:
    positions = {"a": (0.0, 0.0, 5.0), "b": (30.0, 0.0, 5.0), "c": (60.0, 0.0, 5.0)}
    channel = AcousticChannel(EXACT, 50.0, seed=1)
    channel.send(0, "a", b"x" * 60, positions)
    channel.send(round(0.1 * NS), "c", b"y", positions)
    assert [p.sender for p in run(channel, 0.5) if p.receiver == "b"] == []
    assert channel.counts["collided"] == 1


def test_messages_beyond_reach_are_not_received() -> None:
    channel = AcousticChannel(EXACT, 50.0, seed=1)
    channel.send(0, "a", b"x", {"a": (0.0, 0.0, 5.0), "b": (20_000.0, 0.0, 5.0)})
    assert run(channel, 30.0) == []
    assert channel.counts["too_weak"] == 1


def test_packets_are_lost_at_the_rate_of_the_formula() -> None:
    modem = EXACT._replace(source_level=126.0, detection=-30.0, bit_rate=2000.0, overhead=0.0)
    channel = AcousticChannel(modem, 50.0, seed=3)
    for number in range(2000):
        channel.send(number * NS, "a", bytes(16), TWO)
        channel.receive(number * NS + NS - 1)
    noise = ambient_noise(28_000.0, 5.0, 0.5) + 10.0 * log10(8000.0)
    ratio = 10 ** ((126.0 - transmission_loss(500.0, 28_000.0, 1.5) - noise) / 10.0)
    whole = (1.0 - 0.5 * exp(-0.5 * ratio * 4.0)) ** 128
    assert 0.05 < whole < 0.95, "reception must be uncertain in this case"
    assert channel.counts["delivered"] / 2000 == pytest.approx(whole, abs=0.035)
    assert channel.counts["delivered"] + channel.counts["damaged"] == channel.counts["sent"] == 2000


def test_sound_paths_have_the_lengths_worked_out_by_hand() -> None:
    rays = paths(100.0, 10.0, 20.0, 50.0, bounces=1)
    # direct; over the surface, 10 up and 20 down; over the bottom, 40 down and 30 up
    assert [ray.length for ray in rays] == pytest.approx([hypot(100.0, across) for across in (10.0, 30.0, 70.0)])
    assert [(ray.surface, ray.bottom) for ray in rays] == [(0, 0), (1, 0), (0, 1)]
    twice = paths(100.0, 10.0, 20.0, 50.0, bounces=2)
    # surface then bottom, 10 + 50 + 30; bottom then surface, 40 + 50 + 20
    assert [ray.length for ray in twice[3:]] == pytest.approx([hypot(100.0, 90.0), hypot(100.0, 110.0)])


def test_echoes_reduce_reception() -> None:
    modem = EXACT._replace(surface_loss=15.0, bottom_loss=15.0)
    plain, echoing = (AcousticChannel(modem._replace(bounces=n), 15.0, seed=1) for n in (0, 1))
    snr = []
    for channel in (plain, echoing):
        channel.send(0, "a", b"x" * 16, TWO)
        snr.append(run(channel)[0].snr)
    level = hypot(500.0, 20.0), hypot(500.0, 10.0)  # over the surface, over the bottom; both come almost at once
    echo = sum(
        10 ** (-1.5 - (transmission_loss(x, 28_000.0, 1.5) - transmission_loss(500.0, 28_000.0, 1.5)) / 10)
        for x in level
    )
    assert snr[1] == pytest.approx(-10.0 * log10(10 ** (-snr[0] / 10.0) + echo), abs=0.05)


@given(
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 400_000_000), st.integers(0, 80)), min_size=1, max_size=40),
    st.integers(0, 3),
)
def test_every_message_is_counted_under_exactly_one_result(calls: list[tuple[int, int, int]], bounces: int) -> None:
    names = "abcd"
    positions = {name: (120.0 * i, 40.0 * i * i, 3.0 + i) for i, name in enumerate(names)}
    channel = AcousticChannel(EXACT._replace(bounces=bounces), 20.0, seed=5)
    time_ns, received = 0, 0
    for sender, wait, size in calls:
        time_ns += wait
        channel.send(time_ns, names[sender], bytes(size), positions)
        received += len(channel.receive(time_ns))
    received += len(channel.receive(time_ns + 100 * NS))
    counts = channel.counts
    assert sum(counts[fate] for fate in ("delivered", "damaged", "collided", "deaf", "too_weak")) == 3 * counts["sent"]
    assert received == counts["delivered"]
    assert counts["sent"] + counts["busy"] + counts["too_long"] == len(calls)
    assert not channel._arrivals, "past arrivals are removed"


@pytest.mark.parametrize(
    ("modem", "half"),
    [
        (AcousticModem(wind=0.0), 6900.0),
        (AcousticModem(wind=10.0), 4300.0),
        (AcousticModem(source_level=140.0), 2100.0),
    ],
)
def test_half_of_the_reports_are_lost_at_the_range_that_the_page_states(modem: AcousticModem, half: float) -> None:
    lost = []
    for distance in (0.95 * half, 1.05 * half):
        channel = AcousticChannel(modem, 50.0, seed=1)
        places = {name: (x, 0.0, 10.0) for name, x in (("a", 0.0), ("b", distance))}
        for number in range(400):
            channel.send(20 * number * NS, "a", REPORT, places)
            channel.receive(20 * (number + 1) * NS - 1)
        lost.append(1.0 - channel.counts["delivered"] / 400)
    assert lost[0] < 0.5 < lost[1]


def test_heads_ask_the_others_in_turn_and_measure_where_they_are() -> None:
    """Two heads, each every 4 s; the direction then has a noise of 0.001 rad, the range of 0.1 m."""
    places = {"ship": (10.0, -20.0, 2.0), "a": (70.0, 60.0, 27.0), "b": (10.0, -20.0, 42.0), "c": (40.0, 20.0, 12.0)}
    channel, (angle, metres) = AcousticChannel(EXACT, 50.0, seed=1), [ErrorModel(noise_density=x) for x in (0.002, 0.2)]
    rounds = UsblRounds(channel, ["ship", "b"], list(places), 4 * NS, angle, metres, seed=1)
    channel.send(0, "a", b"hi", places)
    others, fixes = list[Packet](), list[UsblFix]()
    for now in range(0, 17 * NS, NS // 10):
        rounds.ask(now, {} if now < NS else places)
        if now == NS // 2:
            channel.send(now, "a", b"\xf0\x04", places)  # asks nobody
        received, found = rounds.take(now, channel.receive(now), places)
        others, fixes = others + received, fixes + found
    assert [packet.payload for packet in others] == [b"hi"] * 3
    assert [(fix.receiver, fix.sender, fix.sent_ns * 10 // NS) for fix in fixes] == [
        ("ship", "a", 16), ("b", "ship", 28), ("ship", "b", 55), ("b", "a", 69),
        ("ship", "c", 95), ("b", "c", 108), ("ship", "a", 136), ("b", "ship", 148),
    ]  # fmt: skip
    for fix in fixes:
        offset = [a - b for a, b in zip(places[fix.sender], places[fix.receiver], strict=True)]
        size, across = hypot(*offset), 1e-6 * hypot(*offset) ** 2
        assert hypot(*fix.offset) == pytest.approx(size, abs=1e-5)
        assert 1e-5 * size < hypot(*[a - b for a, b in zip(fix.offset, offset, strict=True)]) < 0.005 * size
        wanted = [(0.01 - across) * a * b / size**2 + across * (a is b) for a in offset for b in offset]
        assert fix.covariance == pytest.approx(wanted, abs=1e-9)
