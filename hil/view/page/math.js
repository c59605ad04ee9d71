// Vectors, matrices (column after column, as WebGL takes them) and the axes of the scene.
// The scene has x east, y up, z south; the page gets NED and FRD in metres.

export const toScene = (ned, origin) => [ned[1] - origin[1], -ned[2], -(ned[0] - origin[0])];

export const add = (a, b, share = 1) => [a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]];
export const subtract = (a, b) => add(a, b, -1);
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = a => Math.hypot(...a);
export const unit = a => { const size = length(a) || 1; return a.map(x => x / size); };
export const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
export const wrap = (angle, full = 360) => ((angle % full) + full) % full;
export const DEGREES = 180 / Math.PI;

export function rotate([w, x, y, z], v) {  // a vector by a quaternion
  const u = [x, y, z], t = cross(u, v).map(each => 2 * each);
  return add(add(v, t, w), cross(u, t));
}

export function angles([w, x, y, z]) {  // roll, pitch, heading of an attitude FRD to NED, degrees
  return {
    roll: Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) * DEGREES,
    pitch: Math.asin(clamp(2 * (w * y - z * x), -1, 1)) * DEGREES,
    heading: wrap(Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) * DEGREES),
  };
}

export function perspective(field, aspect, near, far) {
  const f = 1 / Math.tan(field / 2), span = near - far;
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / span, -1, 0, 0, 2 * far * near / span, 0];
}

export function lookAt(eye, target, up) {
  const z = unit(subtract(eye, target)), x = unit(cross(up, z)), y = cross(z, x);
  return [x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, eye), -dot(y, eye), -dot(z, eye), 1];
}

export function multiply(a, b) {
  const out = new Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      out[4 * column + row] = a[row] * b[4 * column] + a[4 + row] * b[4 * column + 1]
        + a[8 + row] * b[4 * column + 2] + a[12 + row] * b[4 * column + 3];
  return out;
}

export const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

export function bodyToScene(attitude, position, origin) {  // of a vehicle: from FRD to the scene
  const axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map(axis => rotate(attitude, axis));
  return [...axes.flatMap(ned => [ned[1], -ned[2], -ned[0], 0]), ...toScene(position, origin), 1];
}

export function placed(position, along, turn) {  // in FRD: x of a part to `along`, turned about it by `turn`
  const x = unit(along), side = Math.abs(x[2]) < 0.9 ? [0, 0, 1] : [0, 1, 0];
  const y0 = unit(cross(side, x)), z0 = cross(x, y0), c = Math.cos(turn), s = Math.sin(turn);
  const y = add(y0.map(v => c * v), z0, s), z = add(z0.map(v => c * v), y0, -s);
  return [...x, 0, ...y, 0, ...z, 0, ...position, 1];
}

export function apply(m, [x, y, z], w = 1) {
  return [0, 1, 2, 3].map(row => m[row] * x + m[4 + row] * y + m[8 + row] * z + m[12 + row] * w);
}

export function niceStep(span, most) {  // the smallest of 1, 2, 5 times a power of ten that divides into at most `most`
  const rough = Math.max(span / most, 1e-6), power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map(each => each * power).find(each => each >= rough * 0.999);
}
