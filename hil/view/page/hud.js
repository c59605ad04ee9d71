// The head-up display: heading tape, depth and speed scales, pitch and roll ladder, and lines of text.
import {bearing, clock, number} from "./format.js";
import {clamp, wrap} from "./math.js";

const LIGHT = "#9df3ff", MARK = "#f2b544", BOX = "rgba(4,24,36,.72)", NAMES = {0: "N", 45: "NE", 90: "E", 135: "SE", 180: "S", 225: "SW", 270: "W", 315: "NW"};

// `see` has roll, pitch, heading (degrees), depth, speed, altitude, target, texts; `withLadder` draws the horizon.
// Below it, `lift` pixels are free for the touch sticks.
export function putHud(parts, width, height, lift, see, withLadder) {
  const narrow = width < 560, small = narrow || height < 380, unit = small ? 11 : 13, wide = Math.min(width * 0.42, 460), {depth, speed, altitude, target} = see;
  const tape = narrow ? 186 : width < 800 ? 96 : 62, texts = inRows(see.texts.filter(Boolean), narrow ? 2 : 1);
  const bottom = height - lift - texts.length * unit * 1.55 - 10, middle = narrow ? (tape + 30 + bottom) / 2 : height * 0.5;
  const half = Math.min(height * 0.24, 190, narrow ? bottom - middle : Infinity);
  parts.put("heading", [width / 2, tape], [-wide / 2 - 16, -3 * unit - 8, wide / 2 + 16, unit + 18], drawHeading, wide, see.heading, target?.heading, unit);
  if (half < 30) return;
  if (withLadder) {
    const reach = Math.min(half, width * 0.18), across = 1.25 * reach + 30;
    parts.put("ladder", [width / 2, middle], [-across, -across, across, across], drawLadder, reach, see.roll, see.pitch, unit);
  }
  const scale = {half, unit}, room = 9 * unit;
  parts.put("depth", [width * (small ? 0.8 : 0.84), middle], [-room, -half - 2, room, half + 2], drawScale,
            {...scale, value: depth, step: depth > 100 ? 10 : 1, of: "m", mark: target?.depth, bed: altitude == null ? null : depth + altitude});
  parts.put("speed", [width * (small ? 0.2 : 0.16), middle], [-room, -half - 2, room, half + 2], drawScale, {...scale, value: speed, step: 0.2, of: "m/s", mark: target?.speed, isLeft: true});
  parts.put("texts", [narrow ? 12 : Math.max(width * 0.11, 126), middle + half + (small ? 20 : 34)], [-2, -unit - 2, 30 * unit, texts.length * unit * 1.55], drawTexts, texts, unit);
}

function inRows(texts, columns) {
  return texts.filter((_, k) => k % columns === 0).map((_, k) => texts.slice(k * columns, (k + 1) * columns).map(text => text.padEnd(24)).join(""));
}

function prepare(pen, unit) {
  pen.lineWidth = 1.6;
  pen.font = `${unit}px ui-monospace, "DejaVu Sans Mono", monospace`;
  pen.shadowColor = "rgba(0,16,24,.9)"; pen.shadowBlur = 3;
  pen.strokeStyle = pen.fillStyle = LIGHT;
}

function drawTexts(pen, texts, unit) {
  prepare(pen, unit);
  texts.forEach((text, k) => pen.fillText(text, 0, k * unit * 1.55));
}

function box(pen, text, x, y, align, size) {
  pen.font = pen.font.replace(/^\d+px/, `${size}px`);
  const wide = pen.measureText(text).width + 16, left = align === "center" ? x - wide / 2 : align === "right" ? x - wide : x;
  pen.fillStyle = BOX; pen.strokeStyle = LIGHT;
  pen.beginPath(); pen.roundRect(left, y - size, wide, size * 1.9, 5); pen.fill(); pen.stroke();
  pen.fillStyle = LIGHT; pen.textAlign = "center";
  pen.fillText(text, left + wide / 2, y + size * 0.3);
}

function drawHeading(pen, wide, heading, target, unit) {
  const scale = wide / 90;  // pixels a degree: 90 degrees are seen
  prepare(pen, unit);
  pen.textAlign = "center";
  pen.beginPath(); pen.moveTo(-wide / 2, 0); pen.lineTo(wide / 2, 0); pen.stroke();
  for (let degree = Math.ceil((heading - 45) / 5) * 5; degree <= heading + 45; degree += 5) {
    const at = (degree - heading) * scale, isTen = degree % 15 === 0;
    pen.beginPath(); pen.moveTo(at, 0); pen.lineTo(at, isTen ? 9 : 5); pen.stroke();
    if (isTen && wide / 6 > 30 || degree % 30 === 0) pen.fillText(NAMES[wrap(degree)] || wrap(degree), at, 9 + unit);
  }
  box(pen, `${bearing(heading)}°`, 0, -unit * 1.3, "center", unit + 4);
  pen.fillStyle = MARK;
  pen.beginPath(); pen.moveTo(0, 2); pen.lineTo(6, 11); pen.lineTo(-6, 11); pen.fill();
  if (target != null) {
    const off = clamp(wrap(target - heading + 180) - 180, -45, 45), at = off * scale;
    pen.strokeStyle = MARK; pen.lineWidth = 3;
    pen.beginPath(); pen.moveTo(at - 8, 14); pen.lineTo(at - 8, 3); pen.moveTo(at + 8, 3); pen.lineTo(at + 8, 14); pen.stroke();
  }
}

function drawLadder(pen, half, roll, pitch, unit) {
  const scale = half / 22;  // pixels a degree of pitch
  prepare(pen, unit);
  pen.save();
  pen.rotate(-roll * Math.PI / 180);
  for (let degree = -80; degree <= 80; degree += 10) {
    const at = (pitch - degree) * scale;
    if (Math.abs(at) > half * 1.15) continue;
    const inner = half * 0.24, outer = degree ? half * 0.5 : half * 0.85;
    pen.setLineDash(degree < 0 ? [8, 6] : []);
    pen.lineWidth = degree ? 1.4 : 2.2;
    pen.beginPath(); pen.moveTo(-outer, at); pen.lineTo(-inner, at); pen.moveTo(inner, at); pen.lineTo(outer, at); pen.stroke();
    if (degree) { pen.textAlign = "left"; pen.fillText(degree, outer + 6, at + unit * 0.35); }
  }
  pen.restore();
  pen.strokeStyle = MARK; pen.lineWidth = 2.4;
  pen.beginPath(); pen.moveTo(-30, 0); pen.lineTo(-12, 0); pen.lineTo(0, 11); pen.lineTo(12, 0); pen.lineTo(30, 0); pen.stroke();
}

function drawScale(pen, {half, unit, value, step, of, mark, bed, isLeft}) {
  if (value == null) return;
  prepare(pen, unit);
  const side = isLeft ? -1 : 1, perStep = half / 2.4, at = v => side * (v - value) / step * perStep;
  pen.textAlign = isLeft ? "right" : "left";
  pen.beginPath(); pen.moveTo(0, -half); pen.lineTo(0, half); pen.stroke();
  for (let n = Math.ceil((value - 2.4 * step) / step * 2); n <= (value + 2.4 * step) / step * 2; n++) {
    const v = n * step / 2, isWhole = n % 2 === 0;
    if (v < -1e-9) continue;
    pen.beginPath(); pen.moveTo(0, at(v)); pen.lineTo(side * (isWhole ? 9 : 5), at(v)); pen.stroke();
    if (isWhole && Math.abs(at(v)) > unit * 1.4) pen.fillText(number(v, isLeft ? 1 : 0), side * 14, at(v) + unit * 0.35);
  }
  if (bed != null && Math.abs(at(bed)) <= half) {
    pen.strokeStyle = pen.fillStyle = "#e0b877"; pen.lineWidth = 5;
    pen.beginPath(); pen.moveTo(0, at(bed)); pen.lineTo(side * 28, at(bed)); pen.stroke();
    pen.lineWidth = 1.6;
    pen.fillText("seabed", side * 34, at(bed) + unit * 0.35);
  }
  if (mark != null) {
    pen.strokeStyle = MARK; pen.lineWidth = 3;
    const to = clamp(at(mark), -half, half);
    pen.beginPath(); pen.moveTo(side * 10, to); pen.lineTo(side * 26, to); pen.stroke();
    pen.lineWidth = 1.6;
  }
  box(pen, `${number(value, isLeft ? 2 : 1)} ${of}`, -side * 8, 0, isLeft ? "left" : "right", unit + 3);
}

// The lines of text at the lower left: altitude, water, thrust, battery, time, delay.
export function hudTexts({panel, now, world, time}) {
  const thrusts = now.thrusts || [], total = thrusts.reduce((sum, each) => sum + Math.abs(each), 0), [vn, ve] = world?.current || [0, 0];
  const speed = Math.hypot(vn, ve), [volts, share] = panel.battery || [], place = panel.target?.places?.[0];
  return [
    `altitude ${number(panel.altitude, 1)} m`,
    place ? `next place ${number(Math.hypot(...place.map((v, k) => v - now.position[k])), 0)} m, ${bearing(Math.atan2(place[1] - now.position[1], place[0] - now.position[0]) * 57.2958)}°` : "",
    speed > 0.005 ? `current ${number(speed, 2)} m/s to ${bearing(Math.atan2(ve, vn) * 57.2958)}°` : "",
    thrusts.length ? `thrust ${number(total, 0)} N` : "",
    volts ? `battery ${number(100 * share, 0)} %  ${number(volts, 1)} V` : "",
    time == null ? "" : `time ${clock(time)}`,
    panel.delay ? `delay ${number(panel.delay.median, 1)} ms` : "",
  ];
}
