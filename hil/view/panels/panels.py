"""The panels beside the scene: instruments, pictures, the thruster link, actions, the log."""

from collections import deque
from collections.abc import Iterable
from html import escape
from typing import Any

import numpy as np

from hil.ros.diagnostics import Diagnostics, to_text
from hil.view.scene import colours

LOG_LINES = 12
BINS = 40  # in the histogram of delays
STYLE = "font-family:system-ui,sans-serif;font-size:12px;line-height:1.45"


class Panels:
    """The panels of one view. `server` is a viser.ViserServer, `names` the vehicles that can be chosen."""

    def __init__(self, server: Any, names: list[str], is_fleet: bool = False) -> None:
        self._gui = gui = server.gui
        self.log = deque[str](maxlen=LOG_LINES)
        self.vehicle = gui.add_dropdown("vehicle", tuple(names) or ("-",))
        self.camera = gui.add_dropdown("camera", ("follow", "free", "top"))
        self.dark = gui.add_checkbox("dark", False)
        self.dark.on_update(lambda _: _set_theme(gui, bool(self.dark.value)))
        _set_theme(gui, False)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Vehicle"):
            self._instruments = gui.add_html("<p>waiting for a vehicle</p>")
            gui.add_html(_legend(colours.LEGEND + (colours.FLEET_LEGEND if is_fleet else ())))
        with tabs.add_tab("Pictures"):
            self.pictures = gui.add_checkbox("receive pictures", False, hint="sent only while a browser is connected")
            self._images: dict[str, Any] = {}
            self._no_pictures = gui.add_html(_text("cameras and sonars of the vehicle appear here"))
            self._image_folder = gui.add_folder("cameras and sonars")
        with tabs.add_tab("Link"):
            self._histogram: Any = None
            self._histogram_folder = gui.add_folder("command delay")
            self._hops = gui.add_html(_text("no command was answered yet"))
            self._health = gui.add_html("")
        self.actions = tabs.add_tab("Actions")
        with tabs.add_tab("Log"):
            self._log = gui.add_html("")

    def choose_from(self, names: list[str]) -> None:
        """Offer these vehicles in the list."""
        if names and tuple(names) != tuple(self.vehicle.options):
            self.vehicle.options = tuple(names)

    def show_instruments(self, svg: str) -> None:
        """Show an SVG image of the instruments."""
        self._instruments.content = svg

    def show_picture(self, title: str, picture: Any) -> None:
        """Show a picture (height x width x 3) under its title."""
        handle = self._images.get(title)
        if handle is None:
            self._no_pictures.visible = False
            with self._image_folder:
                self._images[title] = self._gui.add_image(picture, label=title, format="jpeg", jpeg_quality=80)
        else:
            handle.image = picture

    def show_delays(self, delays_ms: list[float], hops: dict[str, float]) -> None:
        """Show the delays of the newest commands as a histogram, and the median (ms) of each hop."""
        if not delays_ms:
            return
        ordered = sorted(delays_ms)
        middle, most = ordered[len(ordered) // 2], ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))]
        counts, edges = np.histogram(ordered, BINS, (0.0, max(most * 1.1, 0.1)))
        centres = 0.5 * (edges[1:] + edges[:-1])
        data = (centres, counts.astype(float))
        if self._histogram is None:
            from viser import uplot

            with self._histogram_folder:
                self._histogram = self._gui.add_uplot(
                    data,
                    (
                        uplot.Series(label="delay (ms)"),
                        uplot.Series(label="commands", stroke=colours.css(colours.PATH), fill="#93c5fd", width=1.5),
                    ),
                    title="commands by delay, ms",
                    scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
                    aspect=1.6,
                )
        else:
            self._histogram.data = data
        rows = [("all", middle), *hops.items()]
        self._hops.content = _table(
            [(name, f"{value:.3f} ms") for name, value in rows],
            f"medians of {len(ordered)} commands; 99 % within {most:.2f} ms",
        )

    def show_health(self, figures: Diagnostics) -> None:
        """Show the slave's diagnostics."""
        if figures:
            self._health.content = _table(health_rows(figures), "the slave, once a second")

    def add_log_line(self, line: str) -> None:
        """Add a line to the log."""
        self.log.append(line)
        self._log.content = "".join(_text(line) for line in reversed(self.log))


def _set_theme(gui: Any, dark: bool) -> None:
    """Set the theme in all browsers, and hide viser's button that shares the page over the internet."""
    gui.configure_theme(show_share_button=False, show_logo=False, control_width="large", dark_mode=dark)


def health_rows(figures: Diagnostics) -> list[tuple[str, str]]:
    """Return the diagnostics that the panel shows, as pairs of name and text."""
    return [
        ("armed", "-" if figures.armed is None else "yes" if figures.armed else "no"),
        ("controller", to_text(figures.controller)),
        ("commanded by", figures.commander or "nobody"),
        ("STM32", "silent" if figures.stm32_silent else "answers"),
        ("link", f"{to_text(figures.link_protocol)} over {to_text(figures.link_wire)}"),
        ("messages out, in", f"{to_text(figures.link_messages_out)}, {to_text(figures.link_messages_in)}"),
        ("checksum errors", to_text(figures.link_checksum_errors)),
        ("commands taken", to_text(figures.commands_taken)),
        (
            "commands stale, refused",
            f"{to_text(figures.commands_stale)}, {to_text(figures.commands_refused)}",
        ),
        ("deadman, watchdog", f"{to_text(figures.deadman_trips)}, {to_text(figures.watchdog_trips)} trips"),
        (
            "loop",
            f"{to_text(figures.loop_rate_hz, '.0f')} Hz, late p99 {to_text(figures.lateness_recent_p99_us, '.0f')} us",
        ),
        ("memory", f"{to_text(figures.pss_mib, '.1f')} MiB"),
        ("processor time", f"{to_text(figures.cpu_s, '.1f')} s of {to_text(figures.uptime_s, '.0f')} s"),
        ("temperature", f"{to_text(figures.temperature_c, '.1f')} °C"),
        ("contacts", to_text(figures.contacts)),
        (
            "autopilot minus truth",
            " ".join(
                [
                    f"{name} {to_text(getattr(figures, f'autopilot_{name}_error_{unit}'), '.2f')} {unit}"
                    for name, unit in (("roll", "deg"), ("pitch", "deg"), ("yaw", "deg"), ("position", "m"))
                ]
            ),
        ),
        ("board", to_text(figures.board)),
    ]


def _table(rows: list[tuple[str, str]], caption: str) -> str:
    cells = "".join(
        f'<tr><td style="padding-right:10px;opacity:.75">{escape(name)}</td><td>{escape(value)}</td></tr>'
        for name, value in rows
    )
    return f'<table style="{STYLE};width:100%"><caption style="opacity:.75">{escape(caption)}</caption>{cells}</table>'


def _text(line: str) -> str:
    return f'<p style="{STYLE};margin:3px 8px">{escape(line)}</p>'


def _legend(entries: Iterable[tuple[str, colours.RGB]]) -> str:
    spots = "".join(
        f'<span style="display:inline-block;margin-right:10px"><span style="color:{colours.css(colour)}">&#9644;</span>'
        f" {name}</span> "
        for name, colour in entries
    )
    return f'<p style="{STYLE};margin:3px 8px">{spots}</p>'
