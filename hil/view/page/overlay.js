// What lies over the scene: names, waypoints, colour bar of depth, north arrow, scale.
import {niceStep, toScene} from "./math.js";
import {DEPTH_STOPS} from "./world.js";
import {number} from "./format.js";

const INK = "#e9f7fb", SHADE = "rgba(3,20,30,.55)", FONT = "12px system-ui, sans-serif";

export function putOverlay(parts, width, height, {lift, right}, scene, {waypoints, target, live}) {
  if (!scene.camera.view) return;
  const spot = ned => {
    const at = scene.camera.project(toScene(ned, scene.origin));
    return at && at[0] > -0.05 && at[0] < 1.05 && at[1] > -0.05 && at[1] < 1.05 ? [at[0] * width, at[1] * height] : null;
  };
  putNames(parts, scene, spot, live);
  for (const [kind, list] of [["goal", [scene.content.goal || scene.content.hunt?.target].filter(Boolean)], ["waypoint", waypoints], ["target", target]])
    list.forEach((place, n) => {
      const at = spot(place);
      if (at) parts.put(`${kind}/${n}`, at, [-10, -10, 44, 10], drawDiamond, kind === "goal" ? kind : String(n + 1), list === waypoints ? "#f2b544" : "#6ee7a8");
    });
  parts.put("north", [width - 36, width < 560 ? 176 : width < 800 ? 112 : 96], [-36, -36, 36, 36], drawNorth, angleOfNorth(scene, width, height));
  if (scene.camera.mode === "eye") return;
  const metre = scene.camera.pixelScale * height / scene.camera.range, step = niceStep(130 / metre, 1);
  const size = [step, step / 2, step / 5].find(each => each * metre <= 150) || step / 10, text = size >= 1000 ? `${size / 1000} km` : `${Number(size.toPrecision(2))} m`;
  parts.put("scale", [width - 24 - right, height - 20 - lift], [-154, -22, 2, 2], drawScale, Math.round(size * metre), text);
  const world = scene.world?.world, tall = Math.min(200, height * 0.35);
  if (world && scene.show.depths && width > 640 && world.deepest - world.least >= 0.05)
    parts.put("depths", [18, height - tall - 24 - lift], [-8, -26, 98, tall + 12], drawDepths, world.least, world.deepest, world.contour, tall);
}

function putNames(parts, scene, spot, live) {
  const put = (name, place, text, colour) => {
    const at = spot(place), half = 4.5 * text.length + 8;
    if (at) parts.put(name, at, [-half, -20, half, 0], drawTag, text, colour);
  };
  for (const [name, vehicle] of scene.vehicles) {
    if (!vehicle.now || (scene.camera.mode === "eye" && name === scene.selected)) continue;
    const [n, e, d] = vehicle.now.position;
    put(`name/${name}`, [n, e, d - 0.9 * vehicle.file.dimensions[2] - 0.1], name + (live(name) ? "" : " (lost)"), name === scene.selected ? "#ffd479" : INK);
  }
  const {zones = [], pipelines = []} = scene.content.world || {};
  zones.forEach(({outline, name}, n) => put(`zone/${n}`, [...outline[0], 0], name, "#ff9be4"));
  pipelines.forEach(({pieces, name}, n) => { if (pieces.length) put(`pipeline/${n}`, pieces[pieces.length >> 1][0], name, INK); });
}

function drawTag(pen, text, colour) {
  pen.font = FONT;
  const wide = pen.measureText(text).width;
  pen.fillStyle = SHADE;
  pen.beginPath(); pen.roundRect(-wide / 2 - 5, -20, wide + 10, 18, 4); pen.fill();
  pen.fillStyle = colour;
  pen.textAlign = "center";
  pen.fillText(text, 0, -6);
}

function drawDiamond(pen, text, colour) {
  pen.font = FONT;
  pen.strokeStyle = pen.fillStyle = colour;
  pen.lineWidth = 2; pen.shadowColor = "#03141e"; pen.shadowBlur = 3;
  pen.beginPath(); pen.moveTo(0, -8); pen.lineTo(8, 0); pen.lineTo(0, 8); pen.lineTo(-8, 0); pen.closePath(); pen.stroke();
  pen.fillText(text, 12, 4);
}

function angleOfNorth({camera}, width, height) {  // in the picture
  const {target, range} = camera, a = camera.project(target), b = camera.project([target[0], target[1], target[2] - 0.2 * range]);
  return a && b ? Math.atan2((b[0] - a[0]) * width, (a[1] - b[1]) * height) : 0;
}

function drawNorth(pen, angle) {
  pen.save();
  pen.fillStyle = SHADE;
  pen.beginPath(); pen.arc(0, 0, 20, 0, 7); pen.fill();
  pen.rotate(angle);
  pen.fillStyle = "#ff6b5e";
  pen.beginPath(); pen.moveTo(0, -15); pen.lineTo(5, 2); pen.lineTo(-5, 2); pen.fill();
  pen.fillStyle = "#c8d8df";
  pen.beginPath(); pen.moveTo(0, 15); pen.lineTo(5, 2); pen.lineTo(-5, 2); pen.fill();
  pen.restore();
  pen.font = FONT; pen.fillStyle = INK; pen.textAlign = "center";
  pen.fillText("N", 29 * Math.sin(angle), 4 - 29 * Math.cos(angle));
}

function drawScale(pen, wide, text) {
  pen.font = FONT;
  pen.strokeStyle = INK; pen.lineWidth = 2;
  pen.beginPath(); pen.moveTo(-wide, -5); pen.lineTo(-wide, 0); pen.lineTo(0, 0); pen.lineTo(0, -5); pen.stroke();
  pen.fillStyle = INK; pen.textAlign = "center";
  pen.fillText(text, -wide / 2, -7);
}

function drawDepths(pen, least, deepest, contour, tall) {
  const fill = pen.createLinearGradient(0, 0, 0, tall);
  DEPTH_STOPS.forEach((colour, k) => fill.addColorStop(k / (DEPTH_STOPS.length - 1), colour));
  pen.font = FONT; pen.fillStyle = SHADE;
  pen.beginPath(); pen.roundRect(-8, -26, 106, tall + 38, 6); pen.fill();
  pen.fillStyle = fill;
  pen.fillRect(0, 0, 12, tall);
  pen.fillStyle = INK;
  pen.fillText("seabed, m", 0, -10);
  for (let k = 0; k <= 4; k++) pen.fillText(number(least + (deepest - least) * k / 4, 1), 18, 4 + tall * k / 4);
  if (contour) pen.fillText(`/ ${Number(contour.toPrecision(2))} m`, 48, tall + 4);
}
