// What lies over the scene: names, waypoints, colour bar of depth, north arrow, scale.
import {niceStep, toScene} from "./math.js";
import {DEPTH_STOPS} from "./world.js";
import {number} from "./format.js";

const INK = "#e9f7fb", SHADE = "rgba(3,20,30,.55)";

export function drawOverlay(pen, width, height, scene, {waypoints, target, live}) {
  if (!scene.camera.view) return;
  pen.font = "12px system-ui, sans-serif";
  const spot = ned => {
    const at = scene.camera.project(toScene(ned, scene.origin));
    return at && at[0] > -0.05 && at[0] < 1.05 && at[1] > -0.05 && at[1] < 1.05 ? [at[0] * width, at[1] * height, at[2]] : null;
  };
  drawNames(pen, scene, spot, live);
  for (const [key, list] of [["goal", [scene.content.goal || scene.content.hunt?.target].filter(Boolean)], ["", waypoints], ["", target]])
    list.forEach((place, n) => { const at = spot(place); if (at) diamond(pen, at, key || String(n + 1), list === waypoints ? "#f2b544" : "#6ee7a8"); });
  drawNorth(pen, scene, width - 36, 96);
  if (scene.camera.mode !== "eye") drawScale(pen, scene, width, height);
  if (scene.world && scene.show.depths && scene.camera.mode !== "eye" && width > 560) drawDepths(pen, scene.world.world, height);
}

function drawNames(pen, scene, spot, live) {
  for (const [name, vehicle] of scene.vehicles) {
    if (!vehicle.now || (scene.camera.mode === "eye" && name === scene.selected)) continue;
    const [n, e, d] = vehicle.now.position, at = spot([n, e, d - 0.9 * vehicle.file.dimensions[2] - 0.1]);
    if (!at) continue;
    tag(pen, name + (live(name) ? "" : " (lost)"), at[0], at[1] - 6, name === scene.selected ? "#ffd479" : INK);
  }
  for (const zone of scene.content.world?.zones || []) { const at = spot([...zone.outline[0], 0]); if (at) tag(pen, zone.name, at[0], at[1], "#ff9be4"); }
  for (const line of scene.content.world?.pipelines || []) {
    const piece = line.pieces[line.pieces.length >> 1], at = piece && spot(piece[0]);
    if (at) tag(pen, line.name, at[0], at[1], INK);
  }
}

function tag(pen, text, x, y, colour) {
  const wide = pen.measureText(text).width;
  pen.fillStyle = SHADE;
  pen.beginPath(); pen.roundRect(x - wide / 2 - 5, y - 14, wide + 10, 18, 4); pen.fill();
  pen.fillStyle = colour;
  pen.textAlign = "center";
  pen.fillText(text, x, y);
}

function diamond(pen, [x, y], text, colour) {
  pen.strokeStyle = pen.fillStyle = colour;
  pen.lineWidth = 2;
  pen.beginPath(); pen.moveTo(x, y - 8); pen.lineTo(x + 8, y); pen.lineTo(x, y + 8); pen.lineTo(x - 8, y); pen.closePath(); pen.stroke();
  pen.textAlign = "left";
  pen.fillText(text, x + 12, y + 4);
}

function drawNorth(pen, scene, x, y) {  // the direction of north in the picture
  const target = scene.camera.target, a = scene.camera.project(target), b = scene.camera.project([target[0], target[1], target[2] - 0.2 * scene.camera.range]);
  const angle = a && b ? Math.atan2((b[0] - a[0]) * scene.canvas.clientWidth, (a[1] - b[1]) * scene.canvas.clientHeight) : 0;
  pen.save();
  pen.translate(x, y);
  pen.fillStyle = SHADE;
  pen.beginPath(); pen.arc(0, 0, 20, 0, 7); pen.fill();
  pen.rotate(angle);
  pen.fillStyle = "#ff6b5e";
  pen.beginPath(); pen.moveTo(0, -15); pen.lineTo(5, 2); pen.lineTo(-5, 2); pen.fill();
  pen.fillStyle = "#c8d8df";
  pen.beginPath(); pen.moveTo(0, 15); pen.lineTo(5, 2); pen.lineTo(-5, 2); pen.fill();
  pen.restore();
  pen.fillStyle = INK; pen.textAlign = "center";
  pen.fillText("N", x + 29 * Math.sin(angle), y + 4 - 29 * Math.cos(angle));
}

function drawScale(pen, scene, width, height) {
  const metre = scene.camera.pixelScale * height / scene.camera.range, step = niceStep(130 / metre, 1) / 1;
  const size = [step, step / 2, step / 5].find(each => each * metre <= 150) || step / 10, wide = size * metre, x = width - 24 - wide, y = height - 20;
  pen.strokeStyle = INK; pen.lineWidth = 2;
  pen.beginPath(); pen.moveTo(x, y - 5); pen.lineTo(x, y); pen.lineTo(x + wide, y); pen.lineTo(x + wide, y - 5); pen.stroke();
  pen.fillStyle = INK; pen.textAlign = "center";
  pen.fillText(size >= 1000 ? `${size / 1000} km` : `${Number(size.toPrecision(2))} m`, x + wide / 2, y - 7);
}

function drawDepths(pen, {least, deepest, contour}, height) {
  if (deepest - least < 0.05) return;
  const tall = Math.min(200, height * 0.35), x = 18, y = height - tall - 24, fill = pen.createLinearGradient(0, y, 0, y + tall);
  DEPTH_STOPS.forEach((colour, k) => fill.addColorStop(k / (DEPTH_STOPS.length - 1), colour));
  pen.fillStyle = SHADE;
  pen.beginPath(); pen.roundRect(x - 8, y - 26, 92, tall + 38, 6); pen.fill();
  pen.fillStyle = fill;
  pen.fillRect(x, y, 12, tall);
  pen.fillStyle = INK; pen.textAlign = "left";
  pen.fillText("seabed, m", x, y - 10);
  for (let k = 0; k <= 4; k++) pen.fillText(number(least + (deepest - least) * k / 4, 1), x + 18, y + 4 + tall * k / 4);
  if (contour) pen.fillText(`/ ${Number(contour.toPrecision(2))} m`, x + 48, y + tall + 4);
}
