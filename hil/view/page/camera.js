// The camera of the scene: it follows the vehicle, chases it, looks from above or out of its bow, or moves freely.
import {add, apply, clamp, cross, length, lookAt, multiply, perspective, rotate, subtract, toScene, unit} from "./math.js";

export const MODES = ["follow", "chase", "top", "eye", "free"];
const FIELD = 0.9, UP = [0, 1, 0], NORTH = [0, 0, -1], TOP_HEIGHT = 20;

export class Camera {
  constructor(canvas) {
    this.mode = "follow";
    this.target = [0, 0, 0];
    this.turn = 0.65; this.tilt = 0.42; this.distance = 4;
    this.topDistance = TOP_HEIGHT;
    this.pointers = new Map();
    this.moved = 0;
    canvas.addEventListener("pointerdown", event => this._down(event));
    canvas.addEventListener("pointermove", event => this._move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => this.pointers.delete(event.pointerId));
    canvas.addEventListener("wheel", event => { event.preventDefault(); this._zoom(Math.exp(0.0012 * event.deltaY)); }, {passive: false});
    canvas.addEventListener("contextmenu", event => event.preventDefault());
  }

  choose(mode) {
    if (mode === "chase") { this.turn = 0; this.tilt = 0.3; }
    if (mode === "follow") this.tilt = Math.min(this.tilt, 0.9);
    this.mode = mode;
  }

  // Start at a distance at which the vehicle of this length fills a good part of the picture.
  fit(size) { this.distance = clamp(3.2 * size, 1.2, 60); }

  _down(event) {
    if (this.blocked) return;
    event.target.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.moved = 0;
  }

  _move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before || this.blocked) return;
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId);
    const now = [event.clientX, event.clientY], dx = now[0] - before[0], dy = now[1] - before[1];
    this.pointers.set(event.pointerId, now);
    this.moved += Math.abs(dx) + Math.abs(dy);
    if (others.length) {
      const apart = point => Math.hypot(point[0] - others[0][1][0], point[1] - others[0][1][1]);
      this._zoom(apart(before) / Math.max(apart(now), 1));
    } else if (this.mode === "top" || event.buttons === 2 || event.shiftKey) this._pan(dx, dy, event.target.clientHeight);
    else {
      this.turn -= 0.006 * dx;
      this.tilt = clamp(this.tilt + 0.006 * dy, -1.4, 1.5);
    }
  }

  _pan(dx, dy, height) {
    const scale = 2 * Math.tan(FIELD / 2) * (this.mode === "top" ? this.topDistance : this.distance) / height;
    const level = this.mode === "top" ? [1, 0, 0] : [Math.cos(this.turn), 0, -Math.sin(this.turn)];
    const ahead = this.mode === "top" ? [0, 0, 1] : [Math.sin(this.turn), 0, Math.cos(this.turn)];
    this.offset = add(add(this.offset || [0, 0, 0], level, -dx * scale), ahead, -dy * scale);
  }

  _zoom(factor) {
    if (this.mode === "top") this.topDistance = clamp(this.topDistance * factor, 2, 5000);
    else this.distance = clamp(this.distance * factor, 0.4, 3000);
  }

  recentre() { this.offset = null; }

  // Place the camera for the vehicle at `pose` (position in the scene, attitude; null: none yet) in a picture's shape.
  place(pose, aspect, bow = 0.3) {
    if (pose && this.mode !== "free") this.target = pose.position;
    const target = add(this.target, this.offset || [0, 0, 0]);
    let up = UP, look = target, field = FIELD;
    if (this.mode === "eye" && pose) {
      const ned = axis => toScene(rotate(pose.attitude, axis), [0, 0]);
      this.eye = add(pose.position, ned([bow, 0, 0]));
      look = add(this.eye, ned([1, 0, 0]));
      up = ned([0, 0, -1]);
      field = 1.15;
    } else if (this.mode === "top") {
      this.eye = add(target, UP, this.topDistance);
      up = NORTH;
    } else {
      const turn = this.turn + (this.mode === "chase" && pose ? -pose.heading : 0);
      const level = Math.cos(this.tilt);
      this.eye = add(target, [Math.sin(turn) * level, Math.sin(this.tilt), Math.cos(turn) * level], this.distance);
    }
    this.range = Math.max(length(subtract(this.eye, target)), 0.3);
    const far = Math.max(400, 8 * this.range), near = clamp(this.range * 0.02, 0.03, 5);
    this.projection = perspective(field, aspect, near, far);
    this.pixelScale = 1 / (2 * Math.tan(field / 2));  // of the height of the picture, for 1 m at 1 m
    this.view = multiply(this.projection, lookAt(this.eye, look, up));
    const ahead = unit(subtract(look, this.eye)), right = unit(cross(ahead, up)), reach = Math.tan(field / 2);
    this.rays = {ahead, right: right.map(v => v * reach * aspect), up: cross(right, ahead).map(v => v * reach)};
  }

  // Where a point of the scene is in the picture, from 0 to 1; null behind the camera.
  project(point) {
    const [x, y, , w] = apply(this.view, point);
    return w > 0.01 ? [0.5 + 0.5 * x / w, 0.5 - 0.5 * y / w, w] : null;
  }

  // The ray through a place in the picture (0 to 1): its start and direction.
  ray(x, y) {
    const {ahead, right, up} = this.rays;
    return [this.eye, unit(add(add(ahead, right, 2 * x - 1), up, 1 - 2 * y))];
  }
}
