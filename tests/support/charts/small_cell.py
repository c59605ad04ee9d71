"""A bay of about 1 km x 1 km for tests: deep in the south, land in the north, an island, a rock, a pile."""

from tests.support.charts.s57_encoder import Encoder, Position, square

SOUTH, WEST, NORTH, EAST = 54.0, 10.0, 54.01, 10.016
SHORE = 54.008


def bed(latitude: float, longitude: float) -> float:
    """Return the true depth (m): a plane with a valley, 0 on the shore."""
    return (
        20.0 * (SHORE - latitude) / (SHORE - SOUTH)
        + 4.0 * (longitude - WEST) / (EAST - WEST) * (SHORE - latitude) * 100.0
    )


def position_at(north: float, east: float) -> Position:
    """Return the position at these fractions of the bay."""
    return SOUTH + north * (NORTH - SOUTH), WEST + east * (EAST - WEST)


def bay(scale: int = 10_000) -> Encoder:
    cell = Encoder(scale=scale)
    cell.area(302, square(SOUTH, WEST, NORTH, EAST), CATCOV=1)
    island = square(54.003, 10.006, 54.0036, 10.007)
    cell.area(42, square(SOUTH, WEST, 54.004, EAST), hole=island, DRVAL1=8, DRVAL2=25)
    cell.area(42, square(54.004, WEST, SHORE, EAST), DRVAL1=0, DRVAL2=12)
    cell.area(71, square(SHORE, WEST, NORTH, EAST))
    cell.area(71, island)
    cell.line(43, [(SHORE, WEST), (SHORE, 10.005), (SHORE, EAST)], VALDCO=0)
    cell.line(30, [(SHORE, WEST), (SHORE, EAST)])
    shares = [(0.02 + 0.093 * i, 0.03 + 0.118 * j) for i in range(9) for j in range(9)]
    positions = [position_at(*share) for share in shares]
    cell.soundings([(lat, lon, round(bed(lat, lon), 1)) for lat, lon in positions if lat < SHORE - 1e-4])
    cell.point(153, (54.002, 10.012), VALSOU=5.5, WATLEV=3)
    cell.point(90, (54.0065, 10.004))
    cell.point(86, (54.006, 10.010), WATLEV=7)
    return cell
