// Sticks: keyboard, gamepad, and two sticks under the thumbs. The vehicle moves only while a switch is held.
import {isNew, write} from "./format.js";

const KEYS = {KeyW: ["surge", 1], KeyS: ["surge", -1], KeyD: ["yaw", 1], KeyA: ["yaw", -1],
              KeyE: ["sway", 1], KeyQ: ["sway", -1], KeyF: ["heave", 1], KeyR: ["heave", -1]};
const REACH = 44;  // pixels from the middle of a touch stick to full deflection
const at = id => document.getElementById(id);

export class Sticks {
  constructor() {
    this.down = new Set();
    this.pressed = false;
    this.thumbs = {left: null, right: null};
    window.addEventListener("keydown", event => this._key(event, true), true);
    window.addEventListener("keyup", event => this._key(event, false), true);
    window.addEventListener("blur", () => this.release());
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.release(); });
    at("switch").addEventListener("pointerdown", event => {
      this.pressed = true;
      event.target.setPointerCapture(event.pointerId);
    });
    for (const name of ["pointerup", "pointercancel"]) at("switch").addEventListener(name, () => this.release());
    this._listenToThumb("left");
    this._listenToThumb("right");
  }

  _key(event, isDown) {
    if (event.code !== "Space" && !KEYS[event.code]) return;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.matches?.("select, textarea, input:not([type=checkbox])")) return;  // keys typed into a field do not steer
    event.preventDefault();
    isDown ? this.down.add(event.code) : this.down.delete(event.code);
  }

  release() {
    this.down.clear();
    this.pressed = false;
    for (const side of ["left", "right"]) this._moveThumb(side, null);
  }

  _moveThumb(side, value) {
    this.thumbs[side] = value;
    const knob = at(`${side}stick`).firstElementChild;
    knob.style.transform = value ? `translate(${value[0] * REACH}px, ${-value[1] * REACH}px)` : "";
  }

  _listenToThumb(side) {
    const stick = at(`${side}stick`);
    const follow = event => {
      const box = stick.getBoundingClientRect(), x = event.clientX - box.left - box.width / 2, y = event.clientY - box.top - box.height / 2;
      const scale = 1 / Math.max(REACH, Math.hypot(x, y));
      this._moveThumb(side, [x * scale, -y * scale]);
    };
    stick.addEventListener("pointerdown", event => { event.preventDefault(); stick.setPointerCapture(event.pointerId); follow(event); });
    stick.addEventListener("pointermove", event => { if (this.thumbs[side]) follow(event); });
    for (const name of ["pointerup", "pointercancel"]) stick.addEventListener(name, () => this._moveThumb(side, null));
  }

  _gamepad() {
    const pad = [...(navigator.getGamepads?.() || [])].find(each => each && each.connected);
    write("pad", pad ? "gamepad: " + pad.id.slice(0, 24) : "");
    if (!pad) return null;
    const dead = value => Math.abs(value || 0) < 0.12 ? 0 : value;
    return {held: [4, 5, 6, 7].some(n => pad.buttons[n]?.pressed),
            axes: {yaw: dead(pad.axes[0]), surge: -dead(pad.axes[1]), sway: dead(pad.axes[2]), heave: dead(pad.axes[3])}};
  }

  // What the hands do now: whether a switch is held, and the axes from -1 to 1.
  read() {
    const pad = this._gamepad(), axes = {surge: 0, sway: 0, heave: 0, yaw: 0}, {left, right} = this.thumbs;
    for (const code of this.down) if (KEYS[code]) axes[KEYS[code][0]] += KEYS[code][1];
    if (pad?.held) for (const name in axes) axes[name] += pad.axes[name];
    if (left) { axes.yaw += left[0]; axes.surge += left[1]; }
    if (right) { axes.sway += right[0]; axes.heave -= right[1]; }
    const held = this.pressed || this.down.has("Space") || Boolean(pad?.held || left || right);
    if (isNew("held", held)) at("switch").setAttribute("aria-pressed", String(held));
    return {axes, held};
  }
}
