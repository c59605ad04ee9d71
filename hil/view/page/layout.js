// What is large, what is small, and what is left out; remembered by this browser.
import {MODES} from "./camera.js";
import {COLOUR_MAPS} from "./pictures.js";

const at = id => document.getElementById(id);
const KEY = "uuv-hil-view", THEMES = {auto: "light dark", light: "light", dark: "dark"};
const CAMERA_NAMES = {follow: "follow", chase: "chase", top: "from above", eye: "vehicle's eye", free: "free"};

export class Layout {
  constructor(pictures, parts, scene) {
    this.pictures = pictures; this.parts = parts; this.scene = scene;
    this.kept = {};
    try { this.kept = JSON.parse(localStorage.getItem(KEY)) || {}; } catch { /* a browser without storage forgets */ }
    const {main, sensor, inset = true, camera = "follow", map = "copper", theme = "auto", layers = {}} = this.kept;
    Object.assign(this, {main: main || "scene", sensor: sensor || "", inset, camera, theme: THEMES[theme] ? theme : "auto"});
    this.layers = {hud: true, water: true, depths: true, sensors: true, snow: true, rings: true, ...layers};
    pictures.options = {map: COLOUR_MAPS[map] ? map : "copper", rings: this.layers.rings};
    this.sensors = [];
    at("camera").append(...MODES.map(mode => new Option(CAMERA_NAMES[mode], mode, false, mode === camera)));
    at("map").append(...Object.keys(COLOUR_MAPS).map(name => new Option(name, name, false, name === pictures.options.map)));
    this._listen();
    this._apply();
  }

  keep() {
    const {main, sensor, inset, camera, theme, layers} = this;
    localStorage.setItem(KEY, JSON.stringify({main, sensor, inset, camera, theme, layers, map: this.pictures.options.map}));
  }

  begin({sensors}) {  // without a choice of the person: a picture first, if the vehicle has one
    const names = Object.entries(sensors).filter(([, each]) => each.kind).map(([name]) => name);
    if (!this.kept.main && names.length) this.main = "picture";
    this.offer(names, sensors);
  }

  _listen() {
    for (const name of ["scene", "picture"]) at(`${name}panel`).addEventListener("click", event => {
      if (this.main !== name) { event.stopPropagation(); this.enlarge(name); }
    });
    at("inset").addEventListener("click", () => { this.inset = !this.inset; this._apply(); });
    at("full").addEventListener("click", () => document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen());
    at("camera").addEventListener("change", () => { this.camera = at("camera").value; this.applyLayers(); this.keep(); });
    at("map").addEventListener("change", () => { this.pictures.options.map = at("map").value; this.pictures.isDirty = true; this.keep(); });
    at("layers").addEventListener("click", () => { at("layerbox").hidden = !at("layerbox").hidden; });
    for (const box of document.querySelectorAll("[data-layer]")) {
      box.checked = this.layers[box.dataset.layer];
      box.addEventListener("change", () => { this.layers[box.dataset.layer] = box.checked; this.applyLayers(); this.keep(); });
    }
    at("theme").addEventListener("change", () => { this.theme = at("theme").value; this._apply(); });
    at("snapshot").addEventListener("click", () => this._save());
    at("sheet").addEventListener("click", () => at("panels").classList.toggle("open"));
  }

  enlarge(name, sensor = this.sensor) {
    this.main = name;
    this.sensor = sensor;
    this.pictures.isDirty = true;
    this._apply();
  }

  isShown(name) { return this.main === name || (this.inset && (name === "scene" || this.sensors.length > 0)); }
  isSonar() { return this.kinds?.[this.sensor] && this.kinds[this.sensor] !== "camera"; }
  wanted() { return this.isShown("picture") && !document.hidden ? (this.sensor ? [this.sensor] : ["?"]) : []; }

  // The sensors whose pictures can be shown: those that came, and those of the scenario.
  offer(came, sensors) {
    const names = [...new Set([...came, ...Object.keys(sensors)])].sort();
    this.kinds = Object.fromEntries(names.map(name => [name, sensors[name]?.kind || this.pictures.newest.get(name)?.header.kind]));
    const key = [names.join(), this.main, this.sensor].join("|");
    if (key === this.offeredKey) return;
    this.offeredKey = key;
    this.sensors = names;
    if (!names.includes(this.sensor)) this.sensor = names[0] || "";
    const views = [...names.map(name => [name.replaceAll("_", " "), "picture", name]), ...(names.length ? [] : [["picture", "picture", ""]]), ["scene", "scene", this.sensor]];
    at("tabs").replaceChildren(...views.map(([label, view, sensor]) => {
      const button = Object.assign(document.createElement("button"), {type: "button", textContent: label});
      button.className = this.main === view && (view === "scene" || sensor === this.sensor) ? "on" : "";
      button.addEventListener("click", () => this.enlarge(view, sensor));
      return button;
    }));
    this._apply(false);
  }

  _apply(isChosen = true) {
    for (const name of ["scene", "picture"]) {
      const panel = at(`${name}panel`);
      panel.classList.toggle("small", this.main !== name);
      panel.classList.toggle("gone", !this.isShown(name));
      panel.dataset.title = name === "scene" ? `scene, ${CAMERA_NAMES[this.camera]}` : this.sensor.replaceAll("_", " ");
    }
    at("camera").hidden = this.main !== "scene";
    at("map").hidden = this.main === "scene" || !this.isSonar();
    document.documentElement.style.colorScheme = THEMES[this.theme];
    at("theme").value = this.theme;
    if (isChosen) { this.offeredKey = ""; this.keep(); }
  }

  applyLayers() {
    const scene = this.scene(), {water, depths, sensors, snow, rings} = this.layers;
    this.pictures.options.rings = rings;
    this.pictures.isDirty = true;
    if (!scene) return;
    Object.assign(scene.show, {water, depths, sensors, snow});
    if (scene.camera.mode !== this.camera) { scene.camera.choose(this.camera); scene.camera.recentre(); }
    this._apply(false);
  }

  // Say over the picture what to do when there is nothing to see.
  tellEmpty(hasPicture, hasVehicle) {
    const place = at("empty");
    const text = !hasVehicle ? "No vehicle yet. Start one: uuv-hil slave paper_field"
      : hasPicture || this.main === "scene" ? ""
      : this.sensors.length ? `Waiting for the first picture of the ${this.sensor.replaceAll("_", " ")}. It is made from now on, while this page shows it.`
      : "This vehicle has no camera or sonar. Give its scenario [sensors.camera] or [sensors.forward_sonar], or show the scene.";
    if (place.textContent !== text) place.textContent = text;
    place.hidden = !text;
  }

  _save() {  // the large picture with what lies over it
    const canvas = this.main === "scene" ? at("scene") : at("picture"), out = document.createElement("canvas");
    if (this.main === "scene") this.scene()?.draw(performance.now());
    out.width = canvas.width; out.height = canvas.height;
    const pen = out.getContext("2d");
    pen.drawImage(canvas, 0, 0);
    pen.scale(out.width / canvas.clientWidth, out.height / canvas.clientHeight);
    this.parts.drawOn(pen);
    const name = `${at("vehicle").value}-${this.main === "scene" ? "scene" : this.sensor}-${new Date().toISOString().slice(0, 19).replaceAll(":", "")}.png`;
    out.toBlob(blob => {
      const link = Object.assign(document.createElement("a"), {href: URL.createObjectURL(blob), download: name});
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
  }
}
