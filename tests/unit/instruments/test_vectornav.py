"""VectorNav's units, read by the driver on PyPI, by the manual's examples, and configured as ArduPilot does."""

from math import radians
from struct import unpack
from typing import Any

import pytest
from vectornav import VN200

from hil.common.clock import NS_PER_MS
from hil.instruments.layout import checksum
from hil.instruments.layout import sentence as line
from hil.instruments.vectornav.unit import Vn100, Vn200
from sim.dynamics import State
from sim.rotations import from_euler
from sim.sensors.error import ErrorModel
from sim.sensors.imu import ImuModel
from sim.sensors.magnetometer import MagnetometerModel
from sim.sensors.samples import ImuSample
from tests.support.instrument_bench import WALL_NS, Bench, Line

EXACT = MagnetometerModel(error_xy=ErrorModel(), error_z=ErrorModel())
ATTITUDE = from_euler(radians(10.0), radians(-20.0), radians(120.0))
RATE, FORCE = (0.1, -0.2, 0.3), (0.5, 1.5, -9.5)


def bench(kind: type[Vn100] = Vn100) -> Bench:
    made = Bench(kind, ImuModel(), kind.Model(magnetometer=EXACT), origin=(57.7, 11.9), origin_altitude=36.2)
    made.scene.present = State((3.0, 4.0, -2.0), ATTITUDE, (1.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    return made


def step(device: Bench, count: int = 1) -> bytes:
    """Return what it sends upon samples at 100 Hz."""
    sent = b""
    for _ in range(count):
        device.now_ns += 10 * NS_PER_MS
        time_ns = WALL_NS + device.now_ns
        sent += device.sample(ImuSample(time_ns, ATTITUDE, RATE, FORCE))
    return sent


def driver(device: Bench) -> Any:
    made = VN200("none", timeout=0.2)
    made._ser = Line(device)
    return made


def test_checksums_are_those_of_the_manual() -> None:
    for text, expected in (("VNRRG,11", b"73"), ("VNWRG,5,9600", b"60"), ("VNYPR,+010.071,+000.278,-002.026", b"60")):
        assert checksum(text.encode()) == expected
    assert line("VNRRG,08,-114.314,+000.058,-001.773") == b"$VNRRG,08,-114.314,+000.058,-001.773*5F\r\n"
    assert checksum(bytes.fromhex("0108009350 2E42833EF13F48B504BB"), with_crc=True) == b"9288"


def test_the_driver_reads_every_register_of_a_vn200() -> None:
    device = bench(Vn200)
    step(device, 200)  # a fix takes a second
    read = driver(device)
    assert read.read_model_number().startswith("VN-200")
    assert isinstance(read.read_serial_number(), int)
    assert read.read_yaw_pitch_roll() == {"yaw": 120.0, "pitch": -20.0, "roll": 10.0}
    turned = read.read_quaternion()
    assert [turned[key] for key in ("q3", "q0", "q1", "q2")] == pytest.approx(ATTITUDE, abs=1e-6)
    everything = read.read_ypr_mag_accel_gyro()
    assert [everything[f"accel_{axis}"] for axis in "xyz"] == pytest.approx(FORCE)
    assert [everything[f"gyro_{axis}"] for axis in "xyz"] == pytest.approx(RATE)
    strength = sum(everything[f"mag_{axis}"] ** 2 for axis in "xyz") ** 0.5
    assert 0.4 < strength < 0.6  # gauss, of the earth
    assert {read.read_quat_mag_accel_gyro()[key] for key in ("mag_x",)} == {read.read_mag_x()}
    assert (read.read_temperature(), read.read_pressure()) == (25.0, 101.325)
    assert read.read_delta_theta_velocity()["delta_time"] == pytest.approx(0.01)
    assert read.read_delta_theta_velocity()["delta_theta_z"] == pytest.approx(0.172, abs=1e-3)
    gps, ins = read.read_gps(), read.read_ins()
    assert (gps["gps_fix"], 5 <= gps["num_satellites"] <= 13) == (3, True)
    assert (gps["latitude"], gps["longitude"]) == pytest.approx((57.7, 11.9), abs=2e-4)
    assert gps["altitude"] == pytest.approx(38.2, abs=15.0)
    seconds = (WALL_NS + device.now_ns) / 1e9 - 315_964_800 + 18
    assert (gps["gps_week"], gps["gps_time"]) == (seconds // 604_800, pytest.approx(seconds % 604_800, abs=0.02))
    assert read.parse_ins_status(ins["ins_status"]) == {"mode": 2, "gps_fix": True, "error": 0}
    speed = sum(ins[f"ned_vel_{axis}"] ** 2 for axis in "xyz") ** 0.5
    assert speed == pytest.approx(1.5, abs=0.01)
    for place in (read.read_gps_ecef(), read.read_ins_ecef(), read.read_ins_state_ecef()):
        assert sum(place[f"position_{axis}"] ** 2 for axis in "xyz") ** 0.5 == pytest.approx(6.363e6, rel=1e-3)
        assert sum(place[f"velocity_{axis}"] ** 2 for axis in "xyz") ** 0.5 == pytest.approx(1.5, abs=0.01)
    assert read.read_ins_state_lla()["latitude"] == ins["latitude"]
    device.scene.present = State((3.0, 4.0, 2.0), ATTITUDE)
    step(device)
    ins = read.read_ins()  # with the last fix
    step(device, 30)
    assert (read.read_gps_fix(), read.read_ins()["ins_status"], read.read_ins_latitude()) == (0, 0, ins["latitude"])


def test_it_starts_with_ascii_outputs_at_40_hz_which_can_be_changed_paused_and_kept() -> None:
    device = bench()
    lines = step(device, 100).split(b"\r\n")[:-1]
    assert len(lines) == 40
    assert all(each.startswith(b"$VNYMR,+120.000,-020.000,+010.000,") for each in lines)
    assert device.ask(b"$VNASY,0*XX\r\n") == line("VNASY,0")
    assert step(device, 10) == b""
    device.ask(b"$VNASY,1*XX\r\n")
    device.ask(b"$VNWRG,07,10*XX\r\n$VNWRG,06,2*XX\r\n")
    assert device.ask(line("VNWRG,06,1,2")) == line("VNWRG,06,1,2")  # of the other port
    assert step(device, 100).count(b"$VNQTN") == 10
    device.ask(b"$VNRST*4D\r\n")
    assert (step(device, 100), device.ask(b"$VNRRG,1*XX\r\n")) == (b"", b"")  # it takes 1.25 s
    assert step(device, 124).count(b"$VNYMR") == 40
    for command in (b"$VNWRG,06,2*XX", b"$VNWNV*57", b"$VNRST*4D"):
        device.ask(command + b"\r\n")
    assert step(device, 224).count(b"$VNQTN") == 40
    device.restart()
    assert step(device, 100).count(b"$VNQTN") == 40
    device.ask(b"$VNRFS*5F\r\n")
    assert step(device, 224).count(b"$VNYMR") == 40


def test_ardupilot_configures_a_vn100_and_reads_its_packet() -> None:
    """The commands, header and length that libraries/AP_ExternalAHRS sends and expects for 50 Hz."""
    device = bench()
    for command in ("VNWRG,6,0", "VNRRG,1", "VNWRG,75,3,16,14,073E,0004"):
        answer = device.ask(line(command))
        assert answer.startswith(f"${command[:5]},{int(command.split(',')[1]):02d},".encode())
        assert answer[:-2].endswith(checksum(answer[1:-5]))
    sent = step(device, 100)
    packets = [sent[at : at + 104] for at in range(0, len(sent), 104)]
    assert len(packets) == 50
    for each in packets:
        assert each[:6] == bytes.fromhex("FA143E070400")
        assert checksum(each[1:], with_crc=True) == b"0000"
    assert device.ask(line("VNBOM,1")) == packets[-1] + line("VNBOM,1")
    values = unpack("<24f", packets[-1][6:-2])
    assert values[3:6] == values[14:17] == pytest.approx(FORCE)
    assert values[6:9] == values[17:20] == pytest.approx(RATE)
    assert values[9:11] == pytest.approx((25.0, 101.325))
    assert values[20:] == pytest.approx((*ATTITUDE[1:], ATTITUDE[0]))


def test_ardupilot_configures_a_vn200_and_reads_its_packets() -> None:
    device = bench(Vn200)
    for command in ("VNWRG,06,0", "VNWRG,75,3,16,34,072E,0106,0612", "VNWRG,76,3,160,4E,0002,0010,20B8,0018"):
        assert device.ask(line(command)) == line(command)
    step(device, 150)
    sent = step(device, 20)
    (first, second), sizes = [bytes.fromhex(h) for h in ("FA342E0706011206", "FA4E02001000B8201800")], (170, 92)
    assert (sent.count(first), sent.count(second), len(sent)) == (10, 1, 10 * sizes[0] + sizes[1])
    at = sent.index(first)
    inertial = unpack("<9ff9f3f4f3f3d3fff", sent[at + 8 : at + sizes[0] - 2])
    assert inertial[-8:-6] == pytest.approx((57.7, 11.9), abs=2e-4)
    at = sent.index(second)
    time_ns, warmth, used, fix, *place = unpack("<QfBB3d3f7fBB", sent[at + 10 : at + sizes[1] - 2])
    assert (warmth, fix, used >= 5, place[-2:]) == (25.0, 3, True, [0, 0])
    assert time_ns / 1e9 == pytest.approx((WALL_NS + device.now_ns) / 1e9 - 315_964_800 + 18, abs=0.3)
    assert place[0] == pytest.approx(57.7, abs=2e-4)


@pytest.mark.parametrize(
    ("command", "error"),
    [
        ("VNRRG,8*00", 3), ("VNXXX,1*XX", 4), ("VNRRG*XX", 5), ("VNWRG,6*XX", 5), ("VNWRG,6,1,1,1*XX", 6),
        ("VNWRG,7,33*XX", 7), ("VNWRG,6,22*XX", 7), ("VNRRG,200*XX", 8), ("VNRRG,63*XX", 8), ("VNWRG,8,1,2,3*XX", 9),
        ("VNWRG,75,1,16,01,8001*XX", 7), ("VNWRG,75,1,16,15,0001,0001*XX", 7), ("VNWRG,75,1,0,01,0001*XX", 7),
    ],
)  # fmt: skip
def test_it_refuses_with_the_number_of_the_error(command: str, error: int) -> None:
    device = bench()
    step(device)
    assert device.ask(f"${command}\r\n".encode()) == line(f"VNERR,{error:02d}")
    assert device.device.malformed == 1


def test_a_crc_of_16_bits_is_taken_always_and_sent_if_asked_for() -> None:
    device = bench()
    step(device)
    request = b"VNRRG,08"
    assert device.ask(b"$%b*%b\r\n" % (request, checksum(request, with_crc=True))).startswith(b"$VNRRG,08,+120.000")
    device.ask(b"$VNWRG,30,0,0,0,0,3,0,1*XX\r\n")
    answer = device.ask(b"$VNRRG,8*4B\r\n")
    assert len(answer.partition(b"*")[2].strip()) == 4
    assert checksum(answer[1:].partition(b"*")[0], with_crc=True) == answer.partition(b"*")[2].strip()
