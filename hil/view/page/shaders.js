// The shaders of the scene. Colours are linear until the last line, which exposes them as a camera does.
// A renderer without a graphics card computes each pixel: exponentials are few, and what adds nothing is skipped.

const WATER = `#version 300 es
precision highp float;
uniform mat4 uView;
uniform vec3 uEye, uAttenuation, uBackscatter, uVeil, uDaylight, uEyeLight, uLampAt, uLampAlong;
uniform float uFog, uExposure, uTime, uLamp;
vec3 daylight(float y) { return exp(-uDaylight * max(-y, 0.0)); }
// What is left of a colour after its way through the water, and the water's own light on that way: that of the middle
// between "day", the daylight there, and that of the eye.
vec3 throughWater(vec3 lit, vec3 at, vec3 day) {
  float way = distance(at, uEye) * uFog;
  if (uEye.y > 0.0) way *= clamp(-at.y / max(uEye.y - at.y, 1e-3), 0.0, 1.0);
  vec3 veil = uVeil * sqrt(day * uEyeLight);
  return lit * exp(-uAttenuation * way) + veil * (1.0 - exp(-uBackscatter * way));
}
vec3 lampLight(vec3 at, vec3 normal) {
  if (uLamp == 0.0) return vec3(0.0);
  vec3 ray = at - uLampAt;
  float away = length(ray), cone = 0.12 + 0.88 * smoothstep(0.72, 0.93, dot(ray, uLampAlong) / max(away, 1e-3));
  float facing = 0.25 + 0.75 * max(dot(normal, -ray) / max(away, 1e-3), 0.0);
  return uLamp * cone * facing / (1.0 + 0.35 * away * away) * exp(-uAttenuation * away);
}
vec3 lit(vec3 albedo, vec3 normal, vec3 at, vec3 day) {
  float sun = 0.4 + 0.6 * max(dot(normal, vec3(0.36, 0.84, 0.4)), 0.0);
  return albedo * (day * sun + lampLight(at, normal));
}
vec3 endless(float up) { return uVeil * uEyeLight * (1.0 + 0.55 * up + 0.25 * up * abs(up)); }
vec3 exposed(vec3 colour) { return sqrt(1.0 - exp(-colour * uExposure)); }
`;

export const MESH = [WATER + `
in vec3 position, normal, colour;
uniform mat4 uModel;
out vec3 vAt, vNormal, vColour;
void main() {
  vec4 at = uModel * vec4(position, 1.0);
  vAt = at.xyz; vNormal = mat3(uModel) * normal; vColour = colour;
  gl_Position = uView * at;
}`, WATER + `
in vec3 vAt, vNormal, vColour;
uniform float uOpacity;
out vec4 outColour;
void main() {
  vec3 normal = normalize(gl_FrontFacing ? vNormal : -vNormal);
  float edge = 1.0 - abs(dot(normal, normalize(uEye - vAt)));
  vec3 day = daylight(vAt.y), colour = lit(vColour * vColour, normal, vAt, day) + edge * edge * edge * 0.15 * day;
  outColour = vec4(exposed(throughWater(colour, vAt, day)), uOpacity);
}`];

export const SEABED = [WATER + `
in vec3 position, normal;
in vec4 colour;
out vec3 vAt, vNormal;
out vec4 vBed;
void main() { vAt = position; vNormal = normal; vBed = colour; gl_Position = uView * vec4(position, 1.0); }
`, WATER + `
in vec3 vAt, vNormal;
in vec4 vBed;
uniform sampler2D uNoise;
uniform vec2 uRange;
uniform vec3 uRipples;
uniform float uContour, uRamp, uRough;
uniform vec3 uStops[5];
out vec4 outColour;
vec3 ramp(float depth) {
  float x = clamp((depth - uRange.x) / max(uRange.y - uRange.x, 0.1), 0.0, 1.0) * 4.0;
  int k = int(min(x, 3.0));
  return mix(uStops[k], uStops[k + 1], x - float(k));
}
void main() {
  float depth = -vAt.y, away = distance(vAt, uEye);
  vec3 day = daylight(vAt.y);
  vec4 coarse = texture(uNoise, vAt.xz * 0.043), fine = texture(uNoise, vAt.xz * 0.61);
  float near = 1.0 / (1.0 + 0.05 * away);
  vec2 slope = (fine.gb - 0.5) * uRough * near + (coarse.gb - 0.5) * uRough * 0.5;
  float phase = dot(uRipples.xy, vAt.xz) + 3.0 * coarse.r;
  slope += uRipples.z * cos(phase) * normalize(uRipples.xy + 1e-6) * near;
  vec3 normal = normalize(vNormal + vec3(slope.x, 0.0, slope.y));
  vec3 bed = vBed.rgb * (1.0 + vBed.a * ((fine.r - 0.5) * near + 0.9 * (coarse.r - 0.5)));
  if (uRamp > 0.0) bed = mix(bed, ramp(depth) * (0.35 + 1.3 * dot(bed, vec3(0.8))), uRamp);
  vec3 colour = lit(bed, normal, vAt, day);
  if (depth < 15.0) {  // deeper, nothing is seen of the light that waves gather
    float shimmer = texture(uNoise, vAt.xz * 0.21 + 0.02 * uTime).r + texture(uNoise, vAt.xz * 0.17 - 0.017 * uTime).r;
    shimmer *= shimmer;
    colour *= 1.0 + 0.9 * exp(-0.22 * depth) * shimmer * shimmer * (1.0 - uRamp);
  }
  if (uContour > 0.0) {
    float f = depth / uContour, w = max(fwidth(f), 1e-5);
    float line = 1.0 - smoothstep(0.4, 1.4, abs(fract(f - 0.5) - 0.5) / w);
    colour *= 1.0 - 0.55 * line * smoothstep(0.6, 0.2, w);
  }
  outColour = vec4(exposed(throughWater(colour, vAt, day)), 1.0);
}`];

// The surface: from below a window of sky around the vertical, and beyond it a mirror; from above nearly clear.
export const SURFACE = [WATER + `
in vec3 position;
out vec3 vAt;
void main() { vAt = position; gl_Position = uView * vec4(position, 1.0); }
`, WATER + `
in vec3 vAt;
uniform sampler2D uNoise;
out vec4 outColour;
void main() {
  vec2 wave = texture(uNoise, vAt.xz * 0.05 + 0.012 * uTime).gb + texture(uNoise, vAt.xz * 0.13 - 0.02 * uTime).gb - 1.0;
  if (uEye.y > 0.0) { outColour = vec4(0.55, 0.75, 0.82, 0.05 + 0.12 * abs(wave.x)); return; }
  vec3 ray = normalize(vAt - uEye);
  float up = ray.y + 0.35 * wave.x;
  vec3 colour = mix(uVeil * 1.2, vec3(0.75, 0.9, 1.0), smoothstep(0.55, 0.8, up)) + 0.1 * max(wave.y, 0.0);
  vec3 left = exp(-uAttenuation * distance(vAt, uEye) * uFog) * smoothstep(0.0, 0.05, ray.y);  // without an edge far away
  outColour = vec4(exposed(mix(endless(ray.y), colour, left)), 1.0);
}`];

// Behind everything: water without end, brighter upwards.
export const BACKDROP = [WATER + `
in vec2 position;
uniform vec3 uAhead, uRight, uUp;
out vec3 vRay;
void main() {
  vRay = uAhead + position.x * uRight + position.y * uUp;
  gl_Position = vec4(position, 1.0, 1.0);
}`, WATER + `
in vec3 vRay;
out vec4 outColour;
void main() {
  outColour = vec4(exposed(endless(normalize(vRay).y)), 1.0);
}`];

// Lines of a width in pixels: a quad for each piece from a to b.
export const LINE = [WATER + `
in vec2 corner;
in vec3 a, b;
uniform mat4 uModel;
uniform vec2 uSize;
uniform float uWidth;
out vec3 vAt;
out float vAlong;
void main() {
  vec4 p = uView * (uModel * vec4(a, 1.0)), q = uView * (uModel * vec4(b, 1.0));
  float near = 0.05;
  if (p.w < near && q.w > near) p = mix(p, q, (near - p.w) / (q.w - p.w));
  if (q.w < near && p.w > near) q = mix(q, p, (near - q.w) / (p.w - q.w));
  vec2 along = (q.xy / q.w - p.xy / p.w) * uSize;
  along = length(along) > 1e-4 ? normalize(along) : vec2(1.0, 0.0);
  vec4 at = corner.x < 0.5 ? p : q;
  at.xy += vec2(-along.y, along.x) * corner.y * uWidth / uSize * at.w;
  at.z -= 0.0005 * at.w;
  vAt = (uModel * vec4(corner.x < 0.5 ? a : b, 1.0)).xyz;
  vAlong = corner.x * length(b - a);
  gl_Position = p.w < near && q.w < near ? vec4(2.0, 2.0, 2.0, 1.0) : at;
}`, WATER + `
in vec3 vAt;
in float vAlong;
uniform vec4 uColour;
out vec4 outColour;
void main() {
  float way = distance(vAt, uEye) * uFog;
  outColour = vec4(uColour.rgb, uColour.a * max(0.25, exp(-0.06 * way)));
}`];

// Particles in a box that moves with the eye.
export const SNOW = [WATER + `
in vec3 position;
uniform vec3 uDrift;
uniform float uPixels;
out float vBright;
void main() {
  float box = 9.0;
  vec3 at = uEye + mod(position * box + uDrift * uTime - uEye, box) - 0.5 * box;
  float away = distance(at, uEye);
  vBright = smoothstep(4.5, 1.5, away) * step(at.y, -0.05) * smoothstep(0.15, 0.6, away);
  gl_Position = uView * vec4(at, 1.0);
  gl_PointSize = clamp(uPixels * 0.006 / away, 1.0, 5.0);
}`, WATER + `
in float vBright;
out vec4 outColour;
void main() {
  float round = 1.0 - smoothstep(0.2, 0.5, length(gl_PointCoord - 0.5));
  outColour = vec4(0.85, 0.93, 0.95, 0.4 * round * vBright);
}`];

// A sonar's echoes on its fan: polar, `u` across the beams and `v` outwards.
export const FAN = [WATER + `
in vec3 position;
in vec2 uv;
uniform mat4 uModel;
out vec2 vUv;
void main() { vUv = uv; gl_Position = uView * (uModel * vec4(position, 1.0)); }
`, WATER + `
in vec2 vUv;
uniform sampler2D uEchoes;
out vec4 outColour;
void main() {
  float echo = texture(uEchoes, vUv).r, near = smoothstep(0.02, 0.1, vUv.y);
  outColour = vec4(1.0, 0.72, 0.3, near * (0.05 + 0.6 * smoothstep(0.25, 0.9, echo)));
}`];
