// The scene: draws world and vehicles through the water, from the newest samples.
import {Camera} from "./camera.js";
import {Lines, Mesh, Program, createContext, noiseTexture, texture} from "./gl.js";
import {IDENTITY, angles, apply, add, bodyToScene, clamp, placed, rotate, toScene} from "./math.js";
import {BACKDROP, FAN, LINE, MESH, SEABED, SNOW, SURFACE} from "./shaders.js";
import {propellerShape, vehicleShape} from "./shapes.js";
import {COLOURS, DEPTH_STOPS, World, sensorLines} from "./world.js";

const ALLOWED_MS = 60, SHARPEST = 1, COARSEST = 0.3;  // of a frame; pixels drawn for each of the screen
const TRACK_STEP = 0.1, THRUST_M_PER_N = 0.012, FULL_TURN_RATE = 45;  // m; m; rad/s of a propeller at full thrust
const UNKNOWN = {dimensions: [1, 0.5, 0.4], kind: "frame"};

export class Scene {
  constructor(canvas, content) {
    this.canvas = canvas; this.content = content;
    const gl = this.gl = createContext(canvas);
    if (!gl) throw new Error("this browser has no WebGL 2: enable it, or use another browser; pictures and panels work without");
    this.programs = {};
    for (const [name, code] of Object.entries({mesh: MESH, seabed: SEABED, surface: SURFACE, backdrop: BACKDROP, line: LINE, snow: SNOW, fan: FAN}))
      this.programs[name] = new Program(gl, code);
    this.noise = noiseTexture(gl);
    this.world = content.world ? new World(gl, this.programs, content.world) : null;
    this.origin = this.world?.origin || [0, 0];
    this.backdrop = new Mesh(gl, this.programs.backdrop, {position: [[-1, -1, 3, -1, -1, 3], 2]});
    this.snow = new Mesh(gl, this.programs.snow, {position: [Float32Array.from({length: 2100}, Math.random), 3]}, null, gl.POINTS);
    const blades = propellerShape();
    this.propeller = new Mesh(gl, this.programs.mesh, {position: [blades.position, 3], normal: [blades.normal, 3], colour: [blades.colour, 3]});
    this.camera = new Camera(canvas);
    this.vehicles = new Map();
    this.free = new Map();  // lines that are of no vehicle, by key
    this.selected = "";
    this.show = {water: true, depths: true, sensors: true, snow: true};
    this.sharpness = SHARPEST;
    this.frameTimes = [];
    this.time = 0;
    this._drawContent();
  }

  _drawContent() {
    const {path, hunt} = this.content;
    if (path.length > 1) this.setLine("path", path, COLOURS.path, 2.5);
    for (const [name, points] of Object.entries(hunt?.paths || {})) this.setLine(`path/${name}`, points, COLOURS.path, 2);
  }

  // Draw a line through points (NED, m), or separate pieces of a line; it replaces one of that key.
  setLine(key, points, colour, width, isPolyline = true) {
    const entry = this.free.get(key) || {lines: new Lines(this.gl, this.programs.line, isPolyline), colour, width};
    entry.lines.set(points.map(point => toScene(point, this.origin)));
    this.free.set(key, entry);
  }

  vehicle(name) {
    let found = this.vehicles.get(name);
    if (found) return found;
    const gl = this.gl, file = this.content.vehicles[name] || Object.values(this.content.vehicles)[0] || UNKNOWN;
    const shape = vehicleShape(file);
    const pieces = isPolyline => new Lines(gl, this.programs.line, isPolyline);
    found = {
      name, file, hull: new Mesh(gl, this.programs.mesh, {position: [shape.position, 3], normal: [shape.normal, 3], colour: [shape.colour, 3]}),
      thrusts: pieces(false), seen: pieces(false), drop: pieces(true), scans: new Map(), fans: new Map(),
      track: {true: pieces(true), navigation: pieces(true)}, points: {true: [], navigation: []}, turns: (file.thrusters || []).map(() => 0), rates: [],
    };
    const seen = Object.values(this.content.sensors).filter(each => each.kind !== "side_scan").flatMap(sensorLines);
    found.seen.set(seen);
    this.vehicles.set(name, found);
    return found;
  }

  // Take a vehicle's newest sample: position (NED, m), attitude, thrusts (N).
  move(name, now) {
    const vehicle = this.vehicle(name), first = !vehicle.now;
    vehicle.now = now;
    vehicle.model = bodyToScene(now.attitude, now.position, this.origin);
    this._extendTrack(vehicle, "true", now.position);
    if (now.navigation) this._extendTrack(vehicle, "navigation", now.navigation);
    const arrows = [];
    (vehicle.file.thrusters || []).forEach((thruster, k) => {
      const thrust = now.thrusts[k] || 0, share = Math.abs(thrust) / thruster.most;
      vehicle.rates[k] = Math.sign(thrust) * Math.sqrt(share) * FULL_TURN_RATE;
      if (Math.abs(thrust) > 0.2) arrows.push(...arrow(thruster.position, thruster.direction, thrust * THRUST_M_PER_N));
    });
    vehicle.thrusts.set(arrows);
    const bed = this.world?.depthAt(now.position[0], now.position[1]);
    vehicle.drop.set(bed == null ? [] : [now.position, [now.position[0], now.position[1], bed]].map(at => toScene(at, this.origin)));
    if (first && name === this.selected) this.select(name);
  }

  select(name) {
    this.selected = name;
    const vehicle = this.vehicles.get(name);
    if (vehicle?.now && !vehicle.isSeen) { vehicle.isSeen = true; this.camera.fit(Math.max(...vehicle.file.dimensions)); }
  }

  setTrack(name, [track, navigation]) {
    const vehicle = this.vehicle(name);
    vehicle.points = {true: track, navigation};
    for (const kind of ["true", "navigation"]) vehicle.track[kind].set(vehicle.points[kind].map(at => toScene(at, this.origin)));
  }

  _extendTrack(vehicle, kind, position) {
    const points = vehicle.points[kind], last = points[points.length - 1];
    if (last && Math.hypot(last[0] - position[0], last[1] - position[1], last[2] - position[2]) < TRACK_STEP) return;
    points.push(position);
    if (points.length > 4000) vehicle.points[kind] = points.filter((_, k) => k % 2 === 0);
    vehicle.track[kind].set(vehicle.points[kind].map(at => toScene(at, this.origin)));
  }

  setScan(name, sensor, points) {  // in FRD of the sensor: a small star at each
    const vehicle = this.vehicle(name), {position = [0, 0, 0], attitude = [1, 0, 0, 0]} = this.content.sensors[sensor] || {};
    if (!vehicle.scans.has(sensor)) vehicle.scans.set(sensor, new Lines(this.gl, this.programs.line, false));
    const stars = points.map(at => add(position, rotate(attitude, at))).flatMap(at => [add(at, [0, 0, -0.05]), add(at, [0, 0, 0.05])]);
    vehicle.scans.get(sensor).set(stars);
  }

  setFan(name, sensor, image, {beams, first, step, bins}) {  // a sonar's echoes on its own plane
    const vehicle = this.vehicle(name), gl = this.gl, {position = [0, 0, 0], attitude = [1, 0, 0, 0]} = this.content.sensors[sensor] || {};
    let fan = vehicle.fans.get(sensor);
    if (!fan) {
      const at = [], uv = [], indices = [], sides = 48, reach = first + bins * step;
      for (let k = 0; k <= sides; k++) {
        const u = k / sides, angle = beams[0] + u * (beams[beams.length - 1] - beams[0]);
        for (const [r, v] of [[first, 0], [reach, 1]]) { at.push(...add(position, rotate(attitude, [r * Math.cos(angle), r * Math.sin(angle), 0]))); uv.push(u, v); }
        if (k) indices.push(2 * k - 2, 2 * k - 1, 2 * k, 2 * k, 2 * k - 1, 2 * k + 1);
      }
      fan = {mesh: new Mesh(gl, this.programs.fan, {position: [at, 3], uv: [uv, 2]}, new Uint32Array(indices)), echoes: texture(gl, null, false)};
      vehicle.fans.set(sensor, fan);
    }
    gl.bindTexture(gl.TEXTURE_2D, fan.echoes);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, image);
  }

  pose(name = this.selected) {
    const vehicle = this.vehicles.get(name);
    if (!vehicle?.now) return null;
    const {position, attitude} = vehicle.now;
    return {position: toScene(position, this.origin), attitude, heading: angles(attitude).heading * Math.PI / 180, vehicle};
  }

  // Draw one frame at the size at which the canvas is shown, with fewer pixels if the machine is slow.
  draw(now) {
    const {canvas, gl} = this, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    const scale = this.sharpness * Math.min(devicePixelRatio || 1, 1.5);
    const size = [Math.max(1, Math.round(width * scale)), Math.max(1, Math.round(height * scale))];
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    gl.viewport(0, 0, ...size);
    if (!this.isPaused) this.time += Math.min(now - (this.drawn || now), 200) / 1000;
    this.drawn = now;
    const pose = this.pose(), camera = this.camera;
    camera.place(pose, width / height, pose ? 0.5 * pose.vehicle.file.dimensions[0] + 0.05 : 0.3);
    this._drawAll(this._common(pose), size, pose);
  }

  // Called at each frame of the browser: draw fewer pixels where these come slowly, more where they come fast.
  adapt(now) {
    if (this.isPaused) { this.lastFrame = 0; return; }
    const took = this.lastFrame ? now - this.lastFrame : 0;
    this.lastFrame = now;
    if (took <= 0 || took > 2000) return;
    this.frameTimes.push(took);
    if (this.frameTimes.length > 600) this.frameTimes.shift();
    const recent = this.frameTimes.slice(-8), mean = recent.reduce((a, b) => a + b, 0) / recent.length;
    this.wait = (this.wait || 0) + 1;
    if (recent.length < 8 || this.wait < 8) return;
    if (mean > ALLOWED_MS && this.sharpness > COARSEST) { this.sharpness = Math.max(COARSEST, this.sharpness * clamp(Math.sqrt(ALLOWED_MS / mean), 0.5, 0.9)); this.wait = 0; }
    else if (mean < 0.5 * ALLOWED_MS && this.sharpness < SHARPEST && this.wait > 90) { this.sharpness = Math.min(SHARPEST, this.sharpness * 1.15); this.wait = 0; }
  }

  _common(pose) {
    const {water} = this.content, {camera} = this, isEye = camera.mode === "eye";
    const fog = !this.show.water ? 0 : isEye ? 0.7 : clamp(1.2 / camera.range, 0, 0.3);  // from outside the vehicle is always seen
    const daylight = this.show.water ? water.daylight.map(v => 0.8 * v) : [0, 0, 0];
    const depth = Math.max(0, -camera.eye[1], pose ? -pose.position[1] : 0), green = Math.exp(-water.daylight[1] * depth);
    const lamps = pose && (pose.vehicle.file.lamps || Object.values(this.content.sensors).some(each => each.lamps));
    const share = lamps ? clamp(1.2 - green, 0.25, 1) : 0;
    const along = pose ? toScene(rotate(pose.attitude, [0.97, 0, 0.24]), [0, 0]) : [0, -1, 0];
    return {
      uView: camera.view, uAhead: camera.rays.ahead, uRight: camera.rays.right, uUp: camera.rays.up, uEye: camera.eye, uAttenuation: water.attenuation, uBackscatter: water.backscatter,
      uVeil: this.show.water ? water.veil.map((v, k) => 0.004 + 0.45 * v + 0.006 * k) : [0.5, 0.62, 0.7], uDaylight: daylight, uEyeLight: daylight.map(v => Math.exp(v * Math.min(camera.eye[1], 0))),
      uFog: fog, uExposure: 2.3 / Math.pow(Math.max(green, 0.004), 0.75), uTime: this.time,
      uLamp: 2.5 * share * Math.max(green, 0.05), uLampAlong: along,
      uLampAt: pose ? add(pose.position, toScene(rotate(pose.attitude, [0.5 * pose.vehicle.file.dimensions[0], 0, 0]), [0, 0])) : [0, 0, 0],
    };
  }

  // What hides other things comes first, so that no pixel is computed twice.
  _drawAll(common, size, pose) {
    const {gl, programs, world, camera} = this, isEye = camera.mode === "eye", isFar = camera.range > 12;
    gl.disable(gl.BLEND);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    programs.mesh.use({...common, uModel: IDENTITY, uOpacity: 1});
    for (const {mesh, opacity} of world?.solids || []) if (opacity === 1) mesh.draw();
    this._drawVehicles(programs.mesh, isEye);
    if (world) {
      const {least, deepest, contour, bottom} = world.world, [height, wave, heading] = bottom.ripples, k = 2 * Math.PI / wave;
      programs.seabed.use({
        ...common, uNoise: this.noise, uRange: [least, deepest], uContour: this.show.depths && !isEye ? contour : 0,
        uRamp: this.show.depths && !isEye && deepest - least > 0.05 ? (isFar ? 0.75 : 0.45) : 0, uRough: clamp(0.5 + 25 * bottom.roughness, 0.5, 2.5),
        uRipples: [k * Math.sin(heading), -k * Math.cos(heading), Math.min(3 * height * k, 0.8)],
      });
      gl.uniform3fv(programs.seabed.uniforms.uStops[0], DEPTH_STOPS.flatMap(linear));
      world.seabed.draw();
    }
    const isBelow = camera.eye[1] <= 0;
    if (isBelow) this._drawSurface(common);  // from there nothing is seen through it
    programs.backdrop.use(common);
    this.backdrop.draw();
    this._drawClear(common, size, isEye, isBelow);
  }

  _drawVehicles(program, isEye) {
    const now = performance.now(), passed = this.isPaused ? 0 : Math.min((now - (this.spun || now)) / 1000, 0.1);
    this.spun = now;
    for (const vehicle of this.vehicles.values()) {
      if (!vehicle.model || (isEye && vehicle.name === this.selected)) continue;
      program.set({uModel: vehicle.model});
      vehicle.hull.draw();
      (vehicle.file.thrusters || []).forEach((thruster, k) => {
        vehicle.turns[k] += passed * (vehicle.rates[k] || 0);
        program.set({uModel: multiplied(vehicle.model, thruster, vehicle.turns[k])});
        this.propeller.draw();
      });
    }
  }

  _drawSurface(common) {
    if (!this.world || !this.show.water) return;
    this.programs.surface.use({...common, uNoise: this.noise});
    this.world.surface.draw();
  }

  // What is seen through: nets, surface, fans, lines, particles.
  _drawClear(common, size, isEye, isBelow) {
    const {gl, programs, world} = this;
    gl.enable(gl.BLEND);
    programs.mesh.use({...common, uModel: IDENTITY});
    for (const {mesh, opacity} of world?.solids || []) if (opacity < 1) { programs.mesh.set({uOpacity: opacity}); mesh.draw(); }
    gl.depthMask(false);
    if (!isBelow && !gl.isSoftware) this._drawSurface(common);
    if (this.show.sensors) for (const vehicle of this.vehicles.values()) for (const fan of vehicle.fans.values())
      if (vehicle.model && !isEye) { programs.fan.use({...common, uModel: vehicle.model, uEchoes: fan.echoes}); fan.mesh.draw(); }
    programs.line.use({...common, uSize: size.map(each => each / 2)});
    const line = (lines, colour, width, uModel = IDENTITY) => {
      programs.line.set({uColour: colour, uWidth: Math.max(width * this.sharpness, 0.6), uModel});
      lines.draw();
    };
    for (const {lines, colour, width} of [...(world?.lines || []), ...this.free.values()]) line(lines, colour, width);
    for (const vehicle of this.vehicles.values()) {
      line(vehicle.track.navigation, COLOURS.navigation, 1.2);
      line(vehicle.track.true, COLOURS.track, 1.8);
      if (!vehicle.model || (isEye && vehicle.name === this.selected)) continue;
      line(vehicle.drop, COLOURS.drop, 1);
      line(vehicle.thrusts, COLOURS.thrust, 2.5, vehicle.model);
      if (this.show.sensors && vehicle.name === this.selected) line(vehicle.seen, COLOURS.camera, 1, vehicle.model);
      for (const scan of vehicle.scans.values()) line(scan, COLOURS.laser, 2, vehicle.model);
    }
    if (this.show.snow && this.show.water && this.camera.range < 60) {
      programs.snow.use({...common, uDrift: [0.03, -0.02, 0.02], uPixels: size[1]});
      this.snow.draw();
    }
    gl.depthMask(true);
  }

  // The place (NED, m) at a depth under a point of the picture (0 to 1); null if the ray does not meet that level.
  placeAt(x, y, depth) {
    const [start, along] = this.camera.ray(x, y);
    const reach = Math.abs(along[1]) < 1e-6 ? -1 : (-depth - start[1]) / along[1];
    if (reach <= 0) return null;
    const at = add(start, along, reach);
    return [this.origin[0] - at[2], this.origin[1] + at[0], depth];
  }
}

function arrow(from, direction, size) {
  const tip = add(from, direction, size), side = Math.abs(direction[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
  const heads = [1, -1].map(sign => add(add(from, direction, 0.75 * size), side, sign * 0.1 * size));
  return [from, tip, heads[0], tip, heads[1], tip];
}

function multiplied(model, {position, direction, diameter}, turn) {  // of a propeller in its vehicle
  const part = placed(position, direction, turn), out = [];
  for (let column = 0; column < 4; column++) {
    const scaled = part.slice(4 * column, 4 * column + 3).map(v => column < 3 ? v * diameter : v);
    out.push(...apply(model, scaled, column < 3 ? 0 : 1));
  }
  return out;
}

const linear = hex => [1, 3, 5].map(k => (parseInt(hex.slice(k, k + 2), 16) / 255) ** 2);
