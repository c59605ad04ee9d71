"""Profiles of the water column from casts in CSV files."""

from itertools import pairwise
from pathlib import Path

import pytest

from hil.common.errors import ConfigError
from sim.environment.ocean import Profile
from sim.environment.seawater.cast import MAX_ROWS
from sim.environment.world import load_world

WORLD = """\
name = "bay"
source = "test"
extent = [-100.0, 100.0, -100.0, 100.0]
depth = 900.0
{origin}

[ocean.profile]
file = "ctd.csv"
"""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def profile(folder: Path, text: str, origin: str = "") -> Profile:
    (folder / "bay.toml").write_text(WORLD.format(origin=origin))
    (folder / "ctd.csv").write_text(text)
    ocean = load_world(str(folder / "bay.toml")).ocean
    assert ocean is not None
    assert ocean.profile is not None
    return ocean.profile


def mackenzie(temperature: float, salinity: float, depth: float) -> float:
    """Return Mackenzie's speed of sound (1981, J. Acoust. Soc. Am. 70(3)), m/s, to 0.07 of Del Grosso's."""
    t, s, d = temperature, salinity - 35.0, depth
    return (
        1448.96 + 4.591 * t - 5.304e-2 * t**2 + 2.374e-4 * t**3 + 1.340 * s + 1.630e-2 * d + 1.675e-7 * d**2
        - 1.025e-2 * t * s - 7.139e-13 * t * d**3
    )  # fmt: skip


@pytest.mark.parametrize("origin", ["", "origin = [47.3, -122.5]"])
def test_temperature_and_salinity_give_density_and_speed_of_sound(tmp_path: Path, origin: str) -> None:
    rows = [(0.0, 14.0, 30.0), (20.0, 11.0, 31.5), (100.0, 9.0, 33.0), (800.0, 4.0, 34.5)]
    lines = ["# cast 7", "Salinity (PSU);Depth (m);Temperature (deg C);Oxygen", *(f"{s};{d};{t};x" for d, t, s in rows)]
    layers = profile(tmp_path, "\n".join(lines), origin)
    assert layers.depth == tuple(row[0] for row in rows)
    for speed, (depth, temperature, salinity) in zip(layers.sound_speed, rows, strict=True):
        assert speed == pytest.approx(mackenzie(temperature, salinity, depth), abs=0.4)
    # UNESCO's equation of state (Fofonoff and Millard 1983): 1022.3 at 14 deg C and 30; the weight adds 3.7 at 800 m
    assert layers.density[0] == pytest.approx(1022.34, abs=0.1)
    assert layers.density[3] == pytest.approx(1027.38 + 3.7, abs=0.15)


def test_pressure_is_converted_to_depth_and_long_casts_are_averaged(tmp_path: Path) -> None:
    rows = [f"{0.5 * k:.1f},{15.0 - 0.005 * k:.3f},34.0" for k in (*range(1600), *range(1599, 0, -1))]
    layers = profile(tmp_path, "\n".join(["pressure,temperature,salinity", *rows]))
    assert len(layers.depth) == MAX_ROWS
    assert all(b > a for a, b in pairwise(layers.depth))
    assert layers.depth[-1] == pytest.approx(786.0, abs=3.0), "799.5 dbar less half a bin are 786 m"


def test_decimal_commas_are_read_where_commas_separate_no_columns(tmp_path: Path) -> None:
    comma = profile(tmp_path, "depth;temperature;salinity\n0,5;14,25;30,5\n20;11;31,5\n")
    assert comma == profile(tmp_path, "depth,temperature,salinity\n0.5,14.25,30.5\n20,11,31.5\n")


def test_a_pressure_a_little_below_zero_is_the_surface(tmp_path: Path) -> None:
    found = profile(tmp_path, "pressure,temperature,salinity\n-0.4,11,35\n-0.2,13,35\n20,9,35\n")
    assert found == profile(tmp_path, "pressure,temperature,salinity\n0,12,35\n20,9,35\n")


def test_measured_columns_are_used_unchanged_and_changed_files_read_again(tmp_path: Path) -> None:
    text = "depth,density,sound_speed\n0,1025,1500\n40,1026,1490\n"
    assert profile(tmp_path, text) == Profile((0.0, 40.0), (1025.0, 1026.0), (1500.0, 1490.0))
    assert profile(tmp_path, text.replace("40,", "45.5,")).depth == (0.0, 45.5)


@pytest.mark.parametrize(("text", "message"), [
    ("depth,temperature\n0,10\n", "without a column 'salinity'"),
    ("temperature,salinity\n10,30\n", "no column 'depth' .* among temperature, salinity"),
    ("depth,sound_speed\n0,1500\n", "no column 'density'"),
    ("depth,temperature,salinity\n0,10,x\n", "row 2 has no number for salinity"),
    ("depth,temperature,salinity\n0,283,35\n", "out of -3 to 45"),
    ("depth,density,sound_speed\n0,1025,150\n", r"ctd.csv: sound_speed\[0\]: 150 m/s is outside"),
    ("depth,temperature,salinity\n", "holds no row"),
    ("depth,temperature,salinity\n-1,10,35\n-50,8,35\n", "ctd.csv: column depth: -50 is above the surface: it counts"),
])  # fmt: skip
def test_errors_name_the_column_and_the_row(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        profile(tmp_path, text)


@pytest.mark.parametrize("rows", ["depth = [0.0]\ndensity = [1025.0]\n", "sound_speed = [1500.0]\n"])
def test_rows_and_a_file_cannot_both_be_given(tmp_path: Path, rows: str) -> None:
    (tmp_path / "bay.toml").write_text(WORLD.format(origin="") + rows)
    with pytest.raises(ConfigError, match="leave depth, density and sound_speed out"):
        load_world(str(tmp_path / "bay.toml"))


def test_comments_of_a_castaway_are_skipped(tmp_path: Path) -> None:
    text = (
        "% Device,CC1\n% Cast time (UTC),x\n% \nPressure (Decibar),Depth (Meter),Temperature (Celsius),Salinity (P)\n"
    )
    assert profile(tmp_path, text + "0.1,0.1,12.0,30.0\n20.2,20.0,10.0,31.0\n").depth == (0.1, 20.0)


CNV = """\
* Sea-Bird SBE 9 Data File:
# nquan = 4
# name 0 = prDM: Pressure, Digiquartz [db]
# name 1 = {temperature} [deg C]
# name 2 = sal00: Salinity, Practical [PSU]
# name 3 = sigma-é00: Density [sigma-theta, Kg/m^3]
# bad_flag = -9.990e-29
*END*
      1.000    14.0000    30.0000    22.3
     20.000    11.0000 -9.990e-29    24.0
    100.000     9.0000    33.0000    25.5
"""


@pytest.mark.parametrize("temperature", ["t090C: Temperature [ITS-90", "t068C: Temperature [ITS-68"])
def test_a_cnv_of_sea_bird_is_read_without_its_bad_rows(tmp_path: Path, temperature: str) -> None:
    (tmp_path / "ctd.cnv").write_bytes(CNV.format(temperature=temperature).encode("latin-1"))
    (tmp_path / "bay.toml").write_text(WORLD.format(origin="").replace("ctd.csv", "ctd.cnv"))
    ocean = load_world(str(tmp_path / "bay.toml")).ocean
    assert ocean is not None
    assert ocean.profile is not None
    assert ocean.profile.depth == pytest.approx((0.99, 99.1), abs=0.1)
    for speed, (t, s, d) in zip(ocean.profile.sound_speed, ((14.0, 30.0, 1.0), (9.0, 33.0, 99.1)), strict=True):
        assert speed == pytest.approx(mackenzie(t, s, d), abs=0.4)


def test_a_cnv_without_names_is_refused(tmp_path: Path) -> None:
    (tmp_path / "ctd.cnv").write_text("1 2 3\n")
    (tmp_path / "bay.toml").write_text(WORLD.format(origin="").replace("ctd.csv", "ctd.cnv"))
    with pytest.raises(ConfigError, match=r"no \.cnv of Sea-Bird with names of columns and rows"):
        load_world(str(tmp_path / "bay.toml"))
