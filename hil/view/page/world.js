// The world of the scene as meshes and lines: seabed, obstacles, surface, paths, zones, current.
import {Lines, Mesh} from "./gl.js";
import {add, niceStep, rotate, toScene, unit} from "./math.js";
import {Shape} from "./shapes.js";

export const DEPTH_STOPS = ["#f3e3a8", "#9fd3a0", "#4aa6a3", "#2a6c97", "#20386f"];  // told apart by the colour-blind too
const NODES = 150, UNKNOWN = 65535, STONE = [0.5, 0.53, 0.53];
export const COLOURS = {
  path: [0.31, 0.56, 1, 1], track: [1, 0.55, 0.15, 1], navigation: [0.75, 0.45, 1, 1], zone: [0.93, 0.25, 0.75, 1],
  current: [0.35, 0.8, 1, 0.8], tether: [0.95, 0.75, 0.2, 1], thrust: [1, 0.3, 0.25, 1], camera: [1, 0.95, 0.75, 0.65],
  sonar: [1, 0.72, 0.3, 0.7], laser: [1, 0.35, 0.3, 1], link: [0.2, 0.85, 0.45, 1], place: [0.95, 0.4, 0.95, 1],
  drop: [1, 1, 1, 0.35], edge: [0.8, 0.95, 1, 0.35],
};

export function readContent(buffer) {  // of the view's server: words, depths of the nodes, materials
  const size = new DataView(buffer).getUint32(0, true);
  const content = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const world = content.world;
  if (world) {
    const count = world.rows * world.columns, span = world.deepest - world.least;
    const steps = new Uint16Array(buffer, 4 + size, count);
    world.depths = Float32Array.from(steps, step => step === UNKNOWN ? NaN : world.least + step / (UNKNOWN - 1) * span);
    world.codes = new Uint8Array(buffer, 4 + size + 2 * count, count);
    world.contour = span > 0.05 ? niceStep(span, 12) : 0;
  }
  return content;
}

export class World {
  constructor(gl, programs, world) {
    this.world = world;
    const [south, north, west, east] = world.extent;
    this.origin = [(south + north) / 2, (west + east) / 2];
    this.lines = [];
    this.solids = [];
    this.gl = gl; this.programs = programs;
    this.seabed = this._seabed();
    this.surface = this._surface();
    this._obstacles();
    this._lines();
  }

  // The depth of the seabed (m) at a place; null outside.
  depthAt(north, east) {
    const {norths, easts, rows, columns, depths} = this.world;
    const i = Math.round((north - norths[0]) / (norths[1] - norths[0]) * (rows - 1));
    const j = Math.round((east - easts[0]) / (easts[1] - easts[0]) * (columns - 1));
    const depth = i >= 0 && j >= 0 && i < rows && j < columns ? depths[i * columns + j] : NaN;
    return Number.isNaN(depth) ? null : depth;
  }

  // The seabed with all nodes, or without a graphics card with at most NODES a side.
  _seabed() {
    const {rows, columns, norths, easts, depths, codes, bottom} = this.world, nodes = this.gl.isSoftware ? NODES : Infinity;
    const step = Math.max(1, Math.ceil(Math.max(rows, columns) / nodes)), high = Math.floor((rows - 1) / step) + 1, wide = Math.floor((columns - 1) / step) + 1;
    const stepN = (norths[1] - norths[0]) / (rows - 1), stepE = (easts[1] - easts[0]) / (columns - 1), indices = [];
    const [position, normal, colour] = [3, 3, 4].map(size => new Float32Array(size * high * wide));
    const depthAt = (i, j) => depths[Math.min(Math.max(i, 0), rows - 1) * columns + Math.min(Math.max(j, 0), columns - 1)];
    for (let i = 0; i < high; i++) for (let j = 0; j < wide; j++) {
      const k = i * wide + j, n = i * step, e = j * step, here = depthAt(n, e) || 0, at = (a, b) => depthAt(n + a * step, e + b * step) || here;
      position.set(toScene([norths[0] + n * stepN, easts[0] + e * stepE, here], this.origin), 3 * k);
      normal.set(unit([(at(0, 1) - at(0, -1)) / (2 * step * stepE), 1, -(at(1, 0) - at(-1, 0)) / (2 * step * stepN)]), 3 * k);
      colour.set((bottom.natures[codes[n * columns + e] || bottom.code] || bottom.natures[bottom.code]).slice(1), 4 * k);
      for (const corners of i && j ? [[[1, 1], [1, 0], [0, 0]], [[1, 1], [0, 0], [0, 1]]] : [])
        if (!corners.some(([a, b]) => Number.isNaN(depthAt(n - a * step, e - b * step)))) indices.push(...corners.map(([a, b]) => k - a * wide - b));
    }
    return new Mesh(this.gl, this.programs.seabed, {position: [position, 3], normal: [normal, 3], colour: [colour, 4]}, new Uint32Array(indices));
  }

  _surface() {
    const [south, north, west, east] = this.world.extent, wide = Math.max(north - south, east - west, 200);
    const corners = [[-1, -1], [-1, 1], [1, -1], [1, 1]].map(([n, e]) => [n * wide, 0, e * wide]);
    return new Mesh(this.gl, this.programs.surface, {position: [corners.flat(), 3]}, new Uint32Array([0, 1, 2, 1, 3, 2]));
  }

  _solid(shape, opacity = 1) {
    const turned = (values, origin) => Array.from({length: values.length / 3}, (_, k) => toScene(values.slice(3 * k, 3 * k + 3), origin)).flat();
    const parts = {position: [turned(shape.position, this.origin), 3], normal: [turned(shape.normal, [0, 0]), 3], colour: [shape.colour, 3]};
    this.solids.push({mesh: new Mesh(this.gl, this.programs.mesh, parts), opacity});
  }

  _obstacles() {
    const upright = new Shape();
    for (const each of this.world.obstacles) {
      const {north, east, top, bottom, radius, size, heading} = each;
      if (size) upright.box([north, east, (top + bottom) / 2], [...size, bottom - top], STONE, heading);
      else upright.tube([north, east, top], [north, east, bottom], radius, STONE);
    }
    if (upright.position.length) this._solid(upright);
    for (const {triangles, colour, net} of this.world.meshes) {
      const shape = new Shape();
      for (let k = 0; k + 8 < triangles.length; k += 9)
        shape.triangle(triangles.slice(k, k + 3), triangles.slice(k + 3, k + 6), triangles.slice(k + 6, k + 9), colour || STONE);
      this._solid(shape, net ? 0.35 : 1);
    }
    for (const {pieces, diameter, colour} of this.world.pipelines) {
      const shape = new Shape();
      for (const [from, to] of pieces) shape.tube(from, to, diameter / 2, colour);
      this._solid(shape);
    }
  }

  _lines() {
    const [south, north, west, east] = this.world.extent;
    const ring = outline => [...outline, outline[0]].map(([n, e]) => toScene([n, e, 0], this.origin));
    this._line(ring([[south, west], [south, east], [north, east], [north, west]]), COLOURS.edge, 1);
    for (const {outline} of this.world.zones) this._line(ring(outline), COLOURS.zone, 2);
    const [vn, ve] = this.world.current, speed = Math.hypot(vn, ve);
    if (speed < 1e-6) return;
    const reach = 0.1 * Math.min(north - south, east - west);
    for (let i = 1; i < 6; i++) for (let j = 1; j < 6; j++) {
      const n = south + (north - south) * i / 6, e = west + (east - west) * j / 6, d = (this.depthAt(n, e) ?? this.world.depth) / 2;
      const tip = [n + vn / speed * reach, e + ve / speed * reach, d], head = a => [
        tip[0] - 0.25 * reach * Math.cos(Math.atan2(ve, vn) + a), tip[1] - 0.25 * reach * Math.sin(Math.atan2(ve, vn) + a), d];
      this._line([[n, e, d], tip, head(0.5), tip, head(-0.5)].map(at => toScene(at, this.origin)), COLOURS.current, 1.5);
    }
  }

  _line(points, colour, width) {
    const lines = new Lines(this.gl, this.programs.line, true);
    lines.set(points);
    this.lines.push({lines, colour, width});
  }
}

// The outline of what a camera sees up to `reach` m, in FRD; of a sonar its fan.
export function sensorLines({kind, position, attitude, width, aspect, range}) {
  const turned = v => add(position, rotate(attitude, v));
  if (kind === "camera") {
    const reach = 0.8, x = Math.tan(width / 2) * reach, y = x / (aspect || 1.33);
    const corners = [[reach, -x, -y], [reach, x, -y], [reach, x, y], [reach, -x, y]].map(turned);
    return corners.flatMap((corner, k) => [position, corner, corner, corners[(k + 1) % 4]]);
  }
  const arc = Array.from({length: 25}, (_, k) => (k / 24 - 0.5) * width).map(a => turned([range * Math.cos(a), range * Math.sin(a), 0]));
  return [position, arc[0], ...arc.slice(1).flatMap((point, k) => [arc[k], point]), arc[24], position];
}
