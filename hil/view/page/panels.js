// The panels at the side: large numbers, compass card, thrusters where they sit, delay of the last minute, log.
import {bearing, isNew, metres, number, write} from "./format.js";

const at = id => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
const LEAST = {info: 0, warning: 1, error: 2};
const MINUTE_MS = 60_000, SHIFT_MS = 500, LOG_LINES = 400;

function svg(name, attributes, text = "") {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== "") made.textContent = text;
  return made;
}

export function showNumbers(see, panel, position) {
  write("nowdepth", number(see.depth, Math.abs(see.depth) < 100 ? 1 : 0));
  write("nowheading", bearing(see.heading));
  write("nowaltitude", number(panel.altitude, 1));
  const {depth, heading} = see.target || {};
  write("todepth", depth == null ? "" : `→ ${number(depth, 1)}`);
  write("toheading", heading == null ? "" : `→ ${bearing(heading)}`);
  const [volts, share] = panel.battery || [];
  write("nowbattery", volts ? number(100 * share, 0) : "–");
  write("volts", volts ? `% ${number(volts, 1)} V` : "no battery");
  const rows = [["north", `${metres(position[0])} m`], ["east", `${metres(position[1])} m`], ["speed", `${number(see.speed, 2)} m/s`],
                ["roll", `${number(see.roll, 0)}°`], ["pitch", `${number(see.pitch, 0)}°`]];
  if (isNew("position", rows)) at("position").replaceChildren(...rows.flatMap(([name, value]) => [["dt", name], ["dd", value]].map(([kind, text]) => {
    const cell = document.createElement(kind);
    cell.textContent = text;
    return cell;
  })));
  if (isNew("compass", [Math.round(10 * see.heading), heading])) showCompass(see);
}

function showCompass({heading, target}) {
  const card = at("compass");
  if (!card.firstChild) {
    const ring = svg("g", {id: "card"});
    ring.append(svg("circle", {r: 54, fill: "none", stroke: "var(--line)", "stroke-width": 2}));
    for (let degree = 0; degree < 360; degree += 10) {
      const turn = {transform: `rotate(${degree})`}, isMain = degree % 30 === 0;
      ring.append(svg("path", {...turn, d: `M0 -54V${isMain ? -46 : -50}`, stroke: degree ? "var(--dim)" : "var(--bad)", "stroke-width": isMain ? 2 : 1}));
      if (isMain) ring.append(svg("text", {...turn, y: -35, "text-anchor": "middle", "font-size": degree % 90 ? 8 : 12, "font-weight": degree % 90 ? 400 : 700,
        fill: degree ? "currentColor" : "var(--bad)"}, {0: "N", 90: "E", 180: "S", 270: "W"}[degree] || degree));
    }
    ring.append(svg("path", {id: "bug", d: "M-6 -58h12l-6 9z", fill: "var(--warn)"}));
    card.append(ring, svg("path", {d: "M0 -51l-5 -9h10z", fill: "var(--accent)"}), svg("path", {d: "M0 -22L8 14L0 8L-8 14Z", fill: "var(--accent)", opacity: 0.8}));
  }
  at("card").setAttribute("transform", `rotate(${-heading})`);
  at("bug").style.display = target?.heading == null ? "none" : "";
  if (target?.heading != null) at("bug").setAttribute("transform", `rotate(${target.heading})`);
}

// Thrusters seen from above, at their places: bars along their direction; those that push up or down as discs.
export function showThrusters(file, thrusts, pwm, failures) {
  const box = at("thrusters"), list = file?.thrusters || [];
  if (!isNew("thrusters", [list, file?.dimensions, thrusts.map(each => number(each, 1)), pwm, failures])) return;
  box.closest("section").hidden = !list.length && !pwm.length;
  if (!list.length) { box.replaceChildren(svg("text", {x: 0, y: 14, "font-size": 11, fill: "currentColor"}, `pulses ${pwm.join(", ")} us`)); return; }
  const [length, width] = file.dimensions, reach = Math.max(...list.map(({position}) => Math.abs(position[0])), length / 2), wide = Math.max(...list.map(({position}) => Math.abs(position[1])), width / 2);
  const scale = Math.min(58 / reach, 92 / wide), spot = ([x, y]) => [135 + y * scale, 80 - x * scale];
  const parts = [svg("rect", {x: 135 - width / 2 * scale, y: 80 - length / 2 * scale, width: width * scale, height: length * scale, rx: Math.min(width * scale / 2, 12), fill: "none", stroke: "var(--dim)", opacity: 0.5}),
                 svg("path", {d: `M129 ${80 - length / 2 * scale - 2}l6 -7l6 7z`, fill: "var(--dim)"})];
  list.forEach((thruster, k) => {
    const [x, y] = spot(thruster.position), thrust = thrusts[k] || 0, share = Math.min(1, Math.abs(thrust) / thruster.most), failed = failures[thruster.name];
    const [dx, dy] = [thruster.direction[1], -thruster.direction[0]], isUpright = Math.hypot(dx, dy) < 0.5, colour = failed ? "var(--bad)" : "var(--accent)";
    if (isUpright) parts.push(svg("circle", {cx: x, cy: y, r: 9, fill: "none", stroke: failed ? colour : "var(--dim)", "stroke-width": 2}), svg("circle", {cx: x, cy: y, r: 9 * Math.sqrt(share), fill: colour}));
    else {
      const turn = Math.atan2(dx, -dy) * 57.2958, size = 22 * share * Math.sign(thrust);
      parts.push(svg("rect", {x: -4, y: -11, width: 8, height: 22, rx: 3, fill: "none", stroke: failed ? colour : "var(--dim)", "stroke-width": 2, transform: `translate(${x} ${y}) rotate(${turn})`}),
                 svg("rect", {x: -4, y: size > 0 ? -size : 0, width: 8, height: Math.abs(size), rx: 2, fill: colour, transform: `translate(${x} ${y}) rotate(${turn})`}));
    }
    // Numbers stand outside of the hull: beside it, or ahead and astern of it, away from those of the neighbours.
    const isLeft = thruster.position[1] < -0.02, isBeside = isUpright || Math.abs(x - 135) < 3 || Math.abs(y - 80) < 15;
    const aside = (isLeft ? -1 : 1) * Math.max(width / 2 * scale + 5, Math.abs(x - 135) + 14), end = length / 2 * scale;
    const place = isBeside ? {x: 135 + aside, y: y + 4, "text-anchor": isLeft ? "end" : "start"}
                           : {x: x + (isLeft ? 12 : -12), y: y < 80 ? Math.min(75 - end, y - 13) : Math.max(92 + end, y + 20), "text-anchor": isLeft ? "end" : "start"};
    const text = svg("text", {...place, "font-size": 10, fill: failed ? colour : "currentColor"}, `${number(thrust, 0)} N`);
    text.append(svg("title", {}, `${thruster.name}: ${number(thrust, 1)} N${pwm[k] ? `, ${pwm[k]} us` : ""}${failed ? `, ${failed}` : ""}`));
    parts.push(text);
  });
  box.replaceChildren(...parts);
}

export class DelayLine {
  constructor() { this.points = []; }

  add(delay) {
    const now = performance.now();
    if (delay) this.points.push([now, delay.newest]);
    if (!isNew("link", [Math.floor(now / SHIFT_MS), Boolean(delay)])) return;
    while (this.points.length && now - this.points[0][0] > MINUTE_MS) this.points.shift();
    const box = at("link"), most = Math.max(...this.points.map(point => point[1]), 1), parts = [];
    const words = delay ? `command delay, last minute: median ${number(delay.median, 1)}, 99 % ${number(delay.p99, 0)} ms` : "no command was answered yet";
    parts.push(svg("text", {x: 0, y: 10, "font-size": 9.5, fill: "currentColor", opacity: 0.7}, words));
    if (this.points.length > 1) {
      const path = this.points.map(([t, ms]) => `${(270 - (now - t) / MINUTE_MS * 270).toFixed(1)} ${(50 - ms / most * 34).toFixed(1)}`).join("L");
      parts.push(svg("path", {d: `M${path}`, fill: "none", stroke: "var(--accent)", "stroke-width": 1.6}));
      parts.push(svg("text", {x: 270, y: 20, "font-size": 9, "text-anchor": "end", fill: "currentColor", opacity: 0.6}, `${number(most, 1)} ms`));
    }
    box.replaceChildren(...parts);
  }
}

export function showHealth(delay, figures) {
  const hops = Object.entries(delay?.hops || {}).map(([name, ms]) => [`delay, ${name}`, `${number(ms, 3)} ms`]);
  at("health").replaceChildren(...[...hops, ...Object.entries(figures || {})].map(cells => {
    const row = document.createElement("tr");
    row.append(...cells.map(text => Object.assign(document.createElement("td"), {textContent: text})));
    return row;
  }));
}

// The log: one line that opens; equal lines that follow each other are counted.
export class Log {
  constructor() {
    this.lines = [];
    at("logline").addEventListener("click", () => { at("logbox").hidden = !at("logbox").hidden; this._show(); });
    for (const id of ["severity", "find"]) at(id).addEventListener("input", () => this._show());
  }

  add(lines) {
    for (const [time, severity, text] of lines) {
      const last = this.lines[this.lines.length - 1];
      if (last && last.text === text && last.severity === severity) { last.count += 1; last.time = time; }
      else this.lines.push({time, severity, text, count: 1});
    }
    this.lines.splice(0, this.lines.length - LOG_LINES);
    if (lines.length) this._show();
  }

  clear() { this.lines = []; }

  _show() {
    const cells = ({time, severity, text, count}, kind) => [Object.assign(document.createElement("time"), {textContent: time}),
      Object.assign(document.createElement(kind), {textContent: text, className: severity}), Object.assign(document.createElement("em"), {textContent: count > 1 ? `× ${count}` : ""})];
    at("logline").replaceChildren(...this.lines.slice(-3).reverse().flatMap((line, k) => cells(line, k ? "span" : "b")));
    if (at("logbox").hidden) return;
    const least = LEAST[at("severity").value], words = at("find").value.toLowerCase();
    const shown = this.lines.filter(line => LEAST[line.severity] >= least && line.text.toLowerCase().includes(words)).reverse();
    at("lines").replaceChildren(...shown.map(line => { const row = document.createElement("li"); row.append(...cells(line, "span")); return row; }));
  }
}

