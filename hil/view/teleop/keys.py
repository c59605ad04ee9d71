"""Keys of a terminal as a stick. A terminal reports no releases: a key counts as held while it repeats."""

from typing import Any

HELD_NS = 650_000_000  # a key counts as held so long; keyboards repeat a held key after up to 0.6 s
AXES = {
    "w": ("surge", 1.0), "s": ("surge", -1.0), "d": ("yaw", 1.0), "a": ("yaw", -1.0),
    "e": ("sway", 1.0), "q": ("sway", -1.0), "f": ("heave", 1.0), "r": ("heave", -1.0),
}  # fmt: skip
HELP = (
    "w s ahead, astern; a d turn; q e to port, to starboard; r f up, down; space stop; x disarm; v arm; m mode; Ctrl-C"
)


class Keys:
    """The keys that are held, as a message for hil.view.teleop.stick.Stick."""

    def __init__(self) -> None:
        self._until_ns: dict[str, int] = {}
        self.effort = False

    def press(self, key: str, now_ns: int) -> None:
        """Handle a key: one of an axis, " " to stop all axes, "m" to switch the mode. Other keys have no effect."""
        if key in AXES:
            opposite = next((other for other in AXES if AXES[other] == (AXES[key][0], -AXES[key][1])), "")
            self._until_ns.pop(opposite, None)
            self._until_ns[key] = now_ns + HELD_NS
        elif key == " ":
            self._until_ns.clear()
        elif key == "m":
            self.effort = not self.effort
            self._until_ns.clear()

    def message(self, now_ns: int) -> dict[str, Any]:
        """Return the present state of the keys, as a message for the stick."""
        held = [key for key, until in self._until_ns.items() if now_ns <= until]
        return {
            "held": bool(held),
            "axes": dict(AXES[key] for key in held),
            "mode": "effort" if self.effort else "velocity",
            "hold_depth": True,
            "hold_heading": True,
        }
