// Shapes of vehicles and obstacles as triangles: hulls, frames, ducts, propellers, fins.
import {add, cross, placed, subtract, unit, apply} from "./math.js";

const YELLOW = [0.95, 0.73, 0.13], DARK = [0.13, 0.16, 0.2], STEEL = [0.62, 0.66, 0.7], BLUE = [0.12, 0.5, 0.78];
const GLASS = [0.75, 0.9, 0.96], LAMP = [1, 0.97, 0.85], BOW = [0.9, 0.2, 0.12], WHITE = [0.93, 0.95, 0.96];
const AROUND = 20;  // sides of what is round

export class Shape {
  constructor() { this.position = []; this.normal = []; this.colour = []; }

  triangle(a, b, c, colour, normals = null) {
    const flat = normals ? null : unit(cross(subtract(b, a), subtract(c, a)));
    [a, b, c].forEach((corner, k) => {
      this.position.push(...corner);
      this.normal.push(...(normals ? normals[k] : flat));
      this.colour.push(...colour);
    });
  }

  quad(a, b, c, d, colour, normals = null) {
    this.triangle(a, b, c, colour, normals && [normals[0], normals[1], normals[2]]);
    this.triangle(a, c, d, colour, normals && [normals[0], normals[2], normals[3]]);
  }

  box([x, y, z], [length, width, height], colour, turn = 0) {
    const c = Math.cos(turn), s = Math.sin(turn);
    const at = (i, j, k) => {
      const u = i * length / 2, v = j * width / 2;
      return [x + c * u - s * v, y + s * u + c * v, z + k * height / 2];
    };
    for (const [o, u, v] of [[[1, -1, -1], [0, 2, 0], [0, 0, 2]], [[-1, -1, -1], [0, 0, 2], [0, 2, 0]],
                             [[-1, 1, -1], [0, 0, 2], [2, 0, 0]], [[-1, -1, -1], [2, 0, 0], [0, 0, 2]],
                             [[-1, -1, 1], [2, 0, 0], [0, 2, 0]], [[-1, -1, -1], [0, 2, 0], [2, 0, 0]]])
      this.quad(at(...o), at(...add(o, u)), at(...add(add(o, u), v)), at(...add(o, v)), colour);
  }

  // A profile of [along, radius] turned about the axis of `frame` (x along it).
  turned(frame, profile, colour, around = AROUND) {
    const spot = ([x, r], k) => {
      const angle = 2 * Math.PI * k / around;
      return apply(frame, [x, r * Math.cos(angle), r * Math.sin(angle)]).slice(0, 3);
    };
    const away = (from, to, k) => {
      const angle = 2 * Math.PI * k / around, dx = to[0] - from[0], dr = to[1] - from[1], size = Math.hypot(dx, dr) || 1;
      return apply(frame, [-dr / size, dx / size * Math.cos(angle), dx / size * Math.sin(angle)], 0).slice(0, 3);
    };
    for (let n = 0; n + 1 < profile.length; n++) for (let k = 0; k < around; k++) {
      const [p, q] = [profile[n], profile[n + 1]], one = away(p, q, k), two = away(p, q, k + 1);
      this.quad(spot(p, k), spot(q, k), spot(q, k + 1), spot(p, k + 1), colour, [one, one, two, two]);
    }
  }

  tube(from, to, radius, colour) {
    const along = subtract(to, from), size = Math.hypot(...along);
    this.turned(placed(from, along, 0), [[0, 0], [0, radius], [size, radius], [size, 0]], colour, radius * 12 > size ? 14 : 8);
  }
}

const AHEAD = [1, 0, 0];

// An open frame: float with a bow mark, side plates as bars, pressure hull with a dome, skids, lamps.
function frame(shape, [length, width, height], boxes) {
  if (boxes.length) for (const [x, y, z, l, w, h] of boxes) shape.box([x, y, z], [l, w, h], YELLOW);
  else {
    for (const side of [-1, 1]) {
      shape.box([-0.02 * length, side * 0.22 * width, -0.36 * height], [0.84 * length, 0.36 * width, 0.26 * height], BLUE);
      shape.box([0.3 * length, side * 0.22 * width, -0.495 * height], [0.16 * length, 0.34 * width, 0.012 * height], BOW);
    }
    shape.box([0.41 * length, 0, -0.36 * height], [0.03 * length, 0.8 * width, 0.22 * height], BOW);
  }
  const bar = 0.05 * height;
  for (const side of [-1, 1]) {
    const y = side * 0.42 * width;
    shape.box([0, y, -0.18 * height], [0.9 * length, bar, 1.6 * bar], DARK);
    shape.box([0, y, 0.45 * height], [0.96 * length, 1.6 * bar, 1.6 * bar], DARK);
    for (const x of [-0.4, 0, 0.4]) shape.box([x * length, y, 0.13 * height], [1.4 * bar, bar, 0.65 * height], DARK);
    shape.tube([0.4 * length, side * 0.24 * width, 0.2 * height], [0.47 * length, side * 0.24 * width, 0.2 * height], 0.08 * height, LAMP);
  }
  for (const x of [-0.38, 0.38]) shape.box([x * length, 0, 0.42 * height], [bar, 0.84 * width, bar], DARK);
  const r = 0.2 * height, dome = [0, 0.3, 0.6, 0.9, 1.2, 1.57].map(a => [0.3 * length + r * Math.sin(a), r * Math.cos(a)]);
  shape.turned(placed([0, 0, 0], AHEAD, 0), [[-0.38 * length, 0], [-0.38 * length, r], [0.3 * length, r]], WHITE);
  shape.turned(placed([0, 0, 0], AHEAD, 0), dome, GLASS);
  shape.tube([-0.3 * length, 0, 0.33 * height], [0.28 * length, 0, 0.33 * height], 0.12 * height, STEEL);
}

function torpedo(shape, [length, width, height]) {
  const r = 0.5 * Math.min(width, height), nose = 0.5 * length, axis = placed([0, 0, 0], AHEAD, 0);
  const bow = Array.from({length: 9}, (_, k) => [nose - 1.6 * r * (1 - Math.sin(k / 8 * 1.5708)), r * Math.cos(k / 8 * 1.5708)]);
  const tail = Array.from({length: 9}, (_, k) => [-0.28 * length - 0.22 * length * k / 8, r * (1 - 0.8 * (k / 8) ** 1.6)]);
  shape.turned(axis, [...tail.reverse(), [nose - 1.6 * r, r]], YELLOW);
  shape.turned(axis, bow, BOW);
  shape.turned(axis, [[-0.5 * length, 0], [-0.5 * length, 0.2 * r]], DARK);
  shape.turned(axis, [[0.1 * length, 1.01 * r], [0.13 * length, 1.01 * r]], DARK);
  shape.box([-0.1 * length, 0, -1.5 * r], [0.03 * length, 0.1 * r, r], DARK);
}

function fin(shape, {position, axis, chord, area, aspect_ratio}) {
  const span = Math.sqrt(area * (aspect_ratio || 2)), depth = area / span, x = unit(chord || [-1, 0, 0]), y = unit(axis);
  const thick = cross(x, y).map(v => 0.05 * depth * v), at = (u, v, w) => add(add(add(position, x, u), y, v), thick, w);
  for (const w of [-1, 1]) {
    const [a, b, c, d] = [at(-depth / 2, -span / 2, w), at(depth / 2, -span / 2, w), at(depth / 2, span / 2, w), at(-depth / 3, span / 2, w)];
    shape.quad(a, b, c, d, DARK);
  }
}

function duct(shape, {position, direction, diameter}) {
  const r = 0.56 * diameter, half = 0.26 * diameter, place = placed(position, direction, 0);
  shape.turned(place, [[-half, r], [half, 1.12 * r], [half, r], [-half, 0.94 * r]], DARK, 18);
  shape.turned(place, [[-1.4 * half, 0.2 * r], [0.9 * half, 0.24 * r], [1.5 * half, 0]], STEEL, 9);
  for (const k of [0, 1, 2]) {
    const a = k * 2.0944 + 0.5, spoke = apply(place, [-half, r * Math.cos(a), r * Math.sin(a)]).slice(0, 3);
    shape.tube(apply(place, [-half, 0, 0]).slice(0, 3), spoke, 0.05 * r, DARK);
  }
}

function meshes(shape, corners) {  // what is foremost marks the bow
  let [back, front] = [Infinity, -Infinity];
  for (const [x] of corners) { back = Math.min(back, x); front = Math.max(front, x); }
  for (let n = 0; n + 2 < corners.length; n += 3) {
    const three = corners.slice(n, n + 3), isBow = three.every(([x]) => x > front - 0.07 * (front - back));
    shape.triangle(...three, isBow ? BOW : YELLOW);
  }
}

export function vehicleShape(vehicle) {
  const shape = new Shape();
  if (vehicle.meshes?.length) meshes(shape, vehicle.meshes.flat());
  else if (vehicle.kind === "torpedo") torpedo(shape, vehicle.dimensions);
  else frame(shape, vehicle.dimensions, vehicle.boxes || []);
  for (const each of vehicle.fins || []) fin(shape, each);
  for (const each of vehicle.thrusters || []) duct(shape, each);
  return shape;
}

// Four blades about x, of the size of a propeller with diameter 1.
export function propellerShape() {
  const shape = new Shape();
  for (let k = 0; k < 4; k++) {
    const a = k * Math.PI / 2, spot = (x, r, t) => [x, r * Math.cos(a + t), r * Math.sin(a + t)];
    shape.quad(spot(0.06, 0.1, 0.3), spot(0.1, 0.47, 0.34), spot(-0.1, 0.47, -0.34), spot(-0.06, 0.1, -0.3), BLUE);
  }
  return shape;
}
