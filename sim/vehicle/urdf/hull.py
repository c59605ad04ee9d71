"""Choose the hull among the links of a model, and add up at the hull what the water does to all links.

A link's numbers are in its own axes (FLU) and about its own origin. The vehicle's origin is that of the hull.
"""

from collections.abc import Mapping
from functools import reduce
from operator import mul
from typing import Any, NamedTuple

from sim.matrices import Matrix, cross_matrix, product, total, transpose
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.text import plain, to_frd, to_frd_matrix

Keys = dict[str, Any]
_DENSITY = 1025.0  # kg/m³: of the sea, for the volume of a link that is neutrally buoyant by itself
_NEARLY_ALL = 0.98  # share of the mass from which a vehicle with neutrally buoyant links is so as a whole
_DUST = 1e-7  # share of the largest entry below which others are rounding errors: angles often have seven digits
MATRICES = ("added_mass", "linear_damping", "quadratic_damping", "forward_speed_damping")


class Tree(NamedTuple):
    """The links of a model: their masses (kg), those with water, and of each child its parent and if it is fixed."""

    masses: Mapping[str, float]
    wet: frozenset[str]
    parents: Mapping[str, tuple[str, bool]]

    def hull(self, usual: str) -> str:
        """Return, of the heaviest body of links that are fixed together, the heaviest link with water.

        Without water in that body it is `usual`, if that has a mass, or the heaviest link.
        """
        bodies = {link: self._above(link)[-1] for link in self.masses}
        sizes = {
            body: sum(mass for link, mass in self.masses.items() if bodies[link] == body) for body in bodies.values()
        }

        def rank(link: str) -> tuple[Any, ...]:
            is_wet, mass, is_usual = link in self.wet, self.masses[link], link == usual
            return sizes[bodies[link]], is_wet, is_usual and mass > 0.0 and not is_wet, mass, is_usual, link

        return max(self.masses, key=rank)

    def carried_mass(self, link: str, hull: str) -> float:
        """Return the mass (kg) of a link with water and of those without that are fixed below it, or to the hull."""

        def carrier(other: str) -> str:
            usual = hull if self.is_fixed_to(other, hull) else ""
            return next((each for each in self._above(other) if each in self.wet), usual)

        return sum(mass for other, mass in self.masses.items() if carrier(other) == link)

    def is_fixed_to(self, link: str, other: str) -> bool:
        """True if no joint between two links moves."""
        return self._above(link)[-1] == self._above(other)[-1]

    def _above(self, link: str) -> list[str]:
        """Return a link and those above it, up to the first joint that moves."""
        chain = [link]
        while (parent := self.parents.get(chain[-1], ("", False)))[1] and parent[0] not in chain:
            chain.append(parent[0])
        return chain


def add_up(waters: Mapping[str, Keys], poses: Mapping[str, Pose], tree: Tree, hull: str, notes: list[str]) -> Keys:
    """Return a vehicle's keys for the water on all links, at their `poses`, and `neutral`; `notes` gets assumptions.

    The order of the links does not matter. Quadratic damping of a link away from the origin or turned is exact for
    motion along or about one body axis at a time.
    """
    links = sorted(waters, key=lambda link: (link != hull, link))
    moving = [link for link in links if not tree.is_fixed_to(link, hull)]
    if moving:
        notes.append(f"On joints that move, taken at zero: the water on {', '.join(map(plain, moving))}.")
    keys = _volume(waters, poses, tree, hull, notes)
    for key in MATRICES:
        parts = [(link, waters[link][key]) for link in links if key in waters[link]]
        if key == "forward_speed_damping":
            turned = [link for link, _ in parts if abs(poses[link].rotation[0][0]) < 1.0 - _DUST]
            notes += [f"Left out: the damping by forward speed of {plain(link)}, which is turned." for link in turned]
            parts = [part for part in parts if part[0] not in turned]
        if parts:
            moved_parts = [moved(matrix, poses[link], key == "quadratic_damping") for link, matrix in parts]
            keys[key] = to_frd_matrix(without_dust(reduce(total, moved_parts)))
    boxed = next((link for link in links if "dimensions" in waters[link]), None)
    if boxed is not None:
        size, rows = waters[boxed]["dimensions"], poses[boxed].rotation
        keys["dimensions"] = [sum(abs(x) * side for x, side in zip(row, size, strict=True)) for row in rows]
    return keys


def moved(matrix: Matrix, pose: Pose, of_squares: bool = False) -> Matrix:
    """Return the 6x6 matrix of a link at `pose`, given about its origin in its axes, about the base in its axes.

    `of_squares` is for a matrix that multiplies the signed squares of the speeds: the result is exact for motion along
    or about one axis at a time.
    """
    turn = transpose(pose.rotation)  # to the link's axes
    lever = product(turn, cross_matrix(pose.position))
    to_link = [[*row, *(-x for x in arm)] for row, arm in zip(turn, lever, strict=True)]
    to_link += [[0.0, 0.0, 0.0, *row] for row in turn]
    speeds = [[x * abs(x) for x in row] for row in to_link] if of_squares else to_link
    return product(transpose(to_link), product(matrix, speeds))


def _volume(waters: Mapping[str, Keys], poses: Mapping[str, Pose], tree: Tree, hull: str, notes: list[str]) -> Keys:
    """Return the volume of all links, its centre, and whether the vehicle is neutrally buoyant."""
    weights = {link: tree.carried_mass(link, hull) for link, keys in waters.items() if keys.get("neutral")}
    neutral = sum(weights.values()) >= _NEARLY_ALL * sum(tree.masses.values()) and bool(weights)
    volumes = {link: keys["volume"] for link, keys in sorted(waters.items()) if "volume" in keys}
    if weights and not neutral:
        volumes |= {link: mass / _DENSITY for link, mass in weights.items()}
        notes.append(f"Neutrally buoyant by themselves, in sea water: {', '.join(map(plain, sorted(weights)))}.")
    keys: Keys = {"neutral": neutral} | ({"volume": sum(volumes.values())} if volumes else {})
    if any("center_of_buoyancy" in of_link for of_link in waters.values()):
        sizes = volumes or {min(waters, key=lambda link: (link != hull, link)): 1.0}
        whole = sum(sizes.values()) or 1.0
        places = [poses[link].transform(waters[link].get("center_of_buoyancy", (0.0, 0.0, 0.0))) for link in sizes]
        shares = [size / whole for size in sizes.values()]
        keys["center_of_buoyancy"] = to_frd(sum(map(mul, shares, along)) for along in zip(*places, strict=True))
    return keys


def without_dust(matrix: Matrix) -> Matrix:
    """Return a matrix with zeros where rounding has left small numbers beside its diagonal."""
    least = _DUST * max(abs(x) for row in matrix for x in row)
    return [[x if i == j or abs(x) > least else 0.0 for j, x in enumerate(row)] for i, row in enumerate(matrix)]
