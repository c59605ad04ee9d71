// Pictures of cameras and sonars: photographs, fans with range rings, side scans; colours, and what the cursor is on.
import {number} from "./format.js";
import {clamp, niceStep} from "./math.js";

export const COLOUR_MAPS = {
  copper: ["#04070c", "#5a3210", "#b5712f", "#f4c98a", "#ffffff"],
  grey: ["#000000", "#404040", "#808080", "#c0c0c0", "#ffffff"],
  viridis: ["#440154", "#3b528b", "#21918c", "#5ec962", "#fde725"],
  ice: ["#03050d", "#1c3f75", "#3b86b5", "#9fd3dc", "#f4fbfb"],
};
const INK = "rgba(190,240,250,.75)", DIM = "rgba(190,240,250,.3)";

export class Pictures {
  constructor(canvas, onImage) {
    this.canvas = canvas; this.onImage = onImage;
    this.newest = new Map();  // by sensor
    this.options = {map: "copper", rings: true};
    this.cursor = null;
    canvas.addEventListener("pointermove", event => { this.cursor = [event.offsetX, event.offsetY]; this.isDirty = true; });
    canvas.addEventListener("pointerleave", () => { this.cursor = null; this.isDirty = true; });
  }

  async take(buffer) {  // a message of the view: header as JSON, then the encoded picture
    const size = new DataView(buffer).getUint32(0, true), header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
    const image = await createImageBitmap(new Blob([new Uint8Array(buffer, 4 + size)], {type: header.type || "image/jpeg"})).catch(() => null);
    if (!image) return;
    const entry = {header, image};
    if (header.kind !== "camera") entry.echoes = levels(image);
    this.newest.set(header.sensor, entry);
    this.isDirty = true;
    this.onImage(header, image);
  }

  forget() { this.newest.clear(); this.isDirty = true; }

  // Draw the newest picture of a sensor; return false without one.
  draw(sensor, isSmall) {
    const {canvas} = this, width = canvas.clientWidth, height = canvas.clientHeight, ratio = Math.min(devicePixelRatio || 1, 2);
    const key = [sensor, width, height, isSmall, this.options.map, this.options.rings].join();
    const entry = this.newest.get(sensor);
    if (!this.isDirty && key === this.drawnKey) return Boolean(entry);
    this.isDirty = false; this.drawnKey = key;
    canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    pen.fillStyle = "#04121d";
    pen.fillRect(0, 0, width, height);
    if (!entry || !width) return Boolean(entry);
    pen.font = `${isSmall ? 10 : 12}px system-ui, sans-serif`;
    const draw = {camera: this._camera, sonar: this._sonar, side_scan: this._sideScan}[entry.header.kind];
    draw.call(this, pen, entry, width, height, isSmall);
    return true;
  }

  _camera(pen, {image}, width, height, isSmall) {
    const cover = Math.max(width / image.width, height / image.height), fit = Math.min(width / image.width, height / image.height);
    const scale = isSmall ? cover : Math.min(cover, 1.7 * fit);  // cut off a little, but not much
    pen.imageSmoothingQuality = "high";
    pen.drawImage(image, (width - image.width * scale) / 2, (height - image.height * scale) / 2, image.width * scale, image.height * scale);
  }

  _coloured(values, width, height) {  // grey levels (-1: outside) as an image
    const table = colourTable(this.options.map), pixels = new Uint32Array(width * height);
    for (let k = 0; k < pixels.length; k++) pixels[k] = values[k] < 0 ? 0 : table[values[k]];
    const canvas = new OffscreenCanvas(width, height);
    canvas.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(pixels.buffer), width, height), 0, 0);
    return canvas;
  }

  _sonar(pen, {header: {beams, first, step, bins}, echoes}, width, height, isSmall) {
    const half = Math.max(Math.abs(beams[0]), Math.abs(beams[beams.length - 1]), 0.1), reach = first + bins * step, margin = isSmall ? 8 : 26;
    const spread = Math.sin(Math.min(half, Math.PI / 2)), radius = Math.max(20, Math.min(height - (isSmall ? 14 : 130), (width / 2 - margin) / spread));
    const bottom = isSmall ? height - 6 : Math.min(height - 14, (height + radius) / 2 + 30), middle = width / 2;
    const fine = Math.min(1, 620 / radius), across = Math.ceil(2 * spread * radius * fine), down = Math.ceil(radius * fine);
    const places = polarPlaces(beams, first, step, bins, across, down, reach / down);
    const values = new Int16Array(places.length);
    for (let k = 0; k < places.length; k++) values[k] = places[k] < 0 ? -1 : echoes.values[places[k]];
    pen.drawImage(this._coloured(values, across, down), middle - spread * radius, bottom - radius, 2 * spread * radius, radius);
    if (this.options.rings) drawRings(pen, middle, bottom, radius, reach, half, isSmall);
    if (this.cursor && !isSmall) {
      const x = this.cursor[0] - middle, y = bottom - this.cursor[1], range = Math.hypot(x, y) / radius * reach, angle = Math.atan2(x, y);
      if (range <= reach && Math.abs(angle) <= half) this._cursorText(pen, `${number(range, 1)} m  ${number(Math.abs(angle) * 57.2958, 0)}° ${angle < 0 ? "port" : "starboard"}`, width);
    }
  }

  _sideScan(pen, {header: {bins, step}, image, echoes}, width, height, isSmall) {
    const tall = Math.min(height, image.height * width / image.width), top = isSmall ? 0 : Math.min(84, height - tall > 0 ? 84 : 0);
    pen.imageSmoothingEnabled = true;
    pen.drawImage(this._coloured(echoes.values, image.width, image.height), 0, top, width, Math.max(tall, height - top));
    if (!this.options.rings) return;
    const reach = bins * step, ring = niceStep(reach, 4);
    pen.strokeStyle = DIM; pen.fillStyle = INK; pen.textAlign = "center";
    for (let r = ring; r < reach; r += ring) for (const side of [-1, 1]) {
      const x = width / 2 * (1 + side * r / reach);
      pen.beginPath(); pen.moveTo(x, top); pen.lineTo(x, height); pen.stroke();
      if (!isSmall) pen.fillText(`${number(r, 0)} m`, x, height - 8);
    }
    if (this.cursor && !isSmall) {
      const range = (this.cursor[0] / width - 0.5) * 2 * reach;
      this._cursorText(pen, `${number(Math.abs(range), 1)} m ${range < 0 ? "port" : "starboard"} (slant)`, width);
    }
  }

  _cursorText(pen, text, width) {
    const [x, y] = this.cursor, wide = pen.measureText(text).width + 12, left = clamp(x + 14, 0, width - wide);
    pen.strokeStyle = INK;
    pen.beginPath(); pen.moveTo(x - 9, y); pen.lineTo(x + 9, y); pen.moveTo(x, y - 9); pen.lineTo(x, y + 9); pen.stroke();
    pen.fillStyle = "rgba(3,20,30,.8)"; pen.fillRect(left, y - 26, wide, 20);
    pen.fillStyle = "#e9f7fb"; pen.textAlign = "left"; pen.fillText(text, left + 6, y - 12);
  }
}

function drawRings(pen, x, y, radius, reach, half, isSmall) {
  const ring = niceStep(reach, 5), from = -Math.PI / 2 - half, to = -Math.PI / 2 + half;
  pen.strokeStyle = DIM; pen.fillStyle = INK; pen.lineWidth = 1; pen.textAlign = "left";
  for (let r = ring; r <= reach * 1.001; r += ring) {
    pen.beginPath(); pen.arc(x, y, r / reach * radius, from, to); pen.stroke();
    const at = [x + r / reach * radius * Math.sin(half) + 5, y - r / reach * radius * Math.cos(half) + 4];
    if (!isSmall) pen.fillText(`${Number(r.toPrecision(3))} m`, Math.min(at[0], x * 2 - 34), at[1]);
  }
  const steps = half > 0.6 ? 30 : 10;
  for (let degree = -180; degree <= 180; degree += steps) {
    const a = degree * Math.PI / 180;
    if (Math.abs(a) > half) continue;
    pen.beginPath(); pen.moveTo(x, y); pen.lineTo(x + radius * Math.sin(a), y - radius * Math.cos(a)); pen.stroke();
    if (!isSmall) { pen.textAlign = "center"; pen.fillText(`${degree}°`, x + (radius + 12) * Math.sin(a), y - (radius + 8) * Math.cos(a)); }
  }
}

let polarCache = {key: ""};
function polarPlaces(beams, first, step, bins, across, down, metre) {  // of each pixel: its echo, or -1 outside the fan
  const key = [beams.length, beams[0], first, step, bins, across, down].join();
  if (polarCache.key === key) return polarCache.places;
  const places = new Int32Array(across * down), count = beams.length, low = beams[0], high = beams[count - 1];
  const columns = new Float32Array(1024).map((_, k) => {  // beams need not be evenly spaced
    const angle = low + (high - low) * k / 1023;
    let best = 0;
    beams.forEach((beam, n) => { if (Math.abs(beam - angle) < Math.abs(beams[best] - angle)) best = n; });
    return best;
  });
  for (let y = 0; y < down; y++) for (let x = 0; x < across; x++) {
    const ahead = (down - y) * metre, right = (x + 0.5 - across / 2) * metre, angle = Math.atan2(right, ahead);
    const row = Math.floor((Math.hypot(ahead, right) - first) / step), inside = row >= 0 && row < bins && angle >= low && angle <= high;
    places[y * across + x] = inside ? row * count + columns[Math.round((angle - low) / (high - low || 1) * 1023)] : -1;
  }
  polarCache = {key, places};
  return places;
}

function levels(image) {  // the grey levels of an image
  const canvas = new OffscreenCanvas(image.width, image.height), pen = canvas.getContext("2d", {willReadFrequently: true});
  pen.drawImage(image, 0, 0);
  const pixels = pen.getImageData(0, 0, image.width, image.height).data, values = new Uint8Array(image.width * image.height);
  for (let k = 0; k < values.length; k++) values[k] = pixels[4 * k];
  return {values};
}

const tables = {};
function colourTable(name) {
  if (tables[name]) return tables[name];
  const stops = COLOUR_MAPS[name].map(hex => [1, 3, 5].map(k => parseInt(hex.slice(k, k + 2), 16)));
  return tables[name] = Uint32Array.from({length: 256}, (_, level) => {
    const at = level / 255 * (stops.length - 1), k = Math.min(Math.floor(at), stops.length - 2);
    const [r, g, b] = stops[k].map((v, c) => Math.round(v + (stops[k + 1][c] - v) * (at - k)));
    return (255 << 24 | b << 16 | g << 8 | r) >>> 0;
  });
}
