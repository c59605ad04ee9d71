// The buttons and fields: what they send, when they may be pressed, and the values that they begin with.
import {bearing, isNew, metres, number, write} from "./format.js";
import {COLOURS} from "./world.js";

const at = id => document.getElementById(id);
const OBSERVES = "this view only observes";
const GRABBED = 16;  // pixels around a waypoint at which it can be dragged
const FAILURES = {efficiency: ["share of thrust", 0.5], noisy: ["share of thrust", 0.3], delayed: ["seconds", 0.5]};
const LEGEND = {"planned path": "path", "track": "track", "track by navigation": "navigation", "thrust": "thrust", "current": "current",
                "tether": "tether", "laser": "laser", "sonar": "sonar", "zone": "zone", "in range of each other": "link", "place in the formation": "place"};

export class Buttons {
  constructor(page) {
    Object.assign(this, page);
    this.edited = new Set();
    this.touched = false;
    const value = id => at(id).value === "" ? null : Number(at(id).value), act = this.act;
    const press = (id, todo) => at(id).addEventListener("click", todo);
    for (const name of ["stop", "take", "still", "release", "reset", "record"]) press(name, () => act(name === "take" && this.state.stick.taken ? "give" : name));
    press("arm", () => act(at("arm").textContent));
    press("hold", () => act("hold", {depth: at("withdepth").checked ? value("holddepth") : null, heading: at("withheading").checked ? value("holdheading") : null, speed: value("holdspeed")}));
    press("pose", () => act("pose", {north: value("north"), east: value("east"), depth: value("down"), heading: value("bow")}));
    press("fail", () => act("fail", {thruster: at("failthruster").value, kind: at("failkind").value, value: value("failvalue")}));
    press("fly", () => act("follow", {points: this.state.waypoints, speed: value("flyspeed")}));
    press("clear", () => { this.state.waypoints = []; this._listWaypoints(); });
    press("pause", () => act("time", {paused: at("pause").textContent === "pause"}));
    press("step", () => act("time", {step: true}));
    at("speed").addEventListener("change", () => act("time", {speed: value("speed")}));
    at("seek").addEventListener("input", () => { this.seeking = performance.now(); act("time", {seek: value("seek")}); });
    at("failkind").addEventListener("change", () => this._askForValue());
    this._askForValue();
    for (const id of ["holddepth", "holdheading", "north", "east", "down", "bow"]) at(id).addEventListener("input", () => this.edited.add(id));
    for (const button of document.querySelectorAll("[data-click]")) button.addEventListener("click", () => {
      for (const other of document.querySelectorAll("[data-click]")) other.classList.toggle("on", other === button);
      at("scene").classList.toggle("aims", Boolean(button.dataset.click));
      this.clickMode = button.dataset.click;
    });
    at("legend").append(...Object.entries(LEGEND).map(([name, key]) => {
      const item = document.createElement("span"), mark = document.createElement("i");
      mark.style.background = `rgb(${COLOURS[key].slice(0, 3).map(v => Math.round(255 * v)).join()})`;
      item.append(mark, name);
      return item;
    }));
    this._listWaypoints();
  }

  begin({vehicles}) {
    const [file] = Object.values(vehicles);
    at("failthruster").replaceChildren(...(file?.thrusters || []).map(({name}) => new Option(name.replaceAll("_", " "), name)));
    this.hasThrusters = Boolean(file?.thrusters?.length);
  }

  forget() { this.edited.clear(); this.startedWith = ""; this._listWaypoints(); }

  _askForValue() {
    const [unit, usual] = FAILURES[at("failkind").value] || [];
    at("failunit").textContent = unit || "";
    at("failvalue").hidden = !unit;
    at("failvalue").value = usual ?? "";
  }

  // Allow what the vehicle accepts now, and show why it does not accept the rest.
  allow(answer, sticks) {
    const {vehicles = [], text = "", may_stop = false, may_steer = false, may_take = false, taken = false, armed} = answer, box = at("vehicle");
    if (!may_steer && sticks.pressed) sticks.release();
    if (!isNew("allowed", answer)) return;
    if (vehicles.length && [...box.options].map(each => each.value).join() !== vehicles.join()) {
      const before = box.value;
      box.replaceChildren(...vehicles.map(name => new Option(name, name)));
      if (vehicles.includes(before)) box.value = before;
      this.forget();
    }
    at("reason").textContent = at("reason").title = text;
    at("reason").classList.toggle("bad", text !== "ready");
    at("stop").disabled = at("arm").disabled = !may_stop;
    at("arm").textContent = armed === false ? "arm" : "disarm";
    at("switch").disabled = !may_steer;
    at("take").hidden = !may_take && !taken;
    at("take").textContent = taken ? "Give back" : "Take over";
    at("take").classList.toggle("main", !taken);
    at("switch").hidden = may_take || text === OBSERVES;
    at("sticks").className = may_steer ? "" : text === OBSERVES ? "absent" : "disabled";
    for (const part of document.querySelectorAll("[data-commands]")) part.hidden = text === OBSERVES;
    for (const part of document.querySelectorAll("[data-commands]"))
      for (const control of part.querySelectorAll("button, input, select")) control.disabled = !may_steer;
  }

  show({see, playback, recording}) {
    if (see) this._beginWith(see);
    if (isNew("recording", recording)) {
      at("record").hidden = !recording?.possible;
      at("record").classList.toggle("on", Boolean(recording?.state));
      at("record").textContent = recording?.state ? `recording, ${recording.state.split(" messages")[0]} messages` : "record";
      at("record").title = recording?.state || "record all messages of the vehicles";
    }
    at("timebox").hidden = !playback;
    if (playback) {
      write("pause", playback.paused ? "go on" : "pause");
      write("seconds", playback.time.toFixed(1));
      at("seek").hidden = !playback.duration;
      at("seek").max = playback.duration;
      if (performance.now() - (this.seeking || -1e4) > 500) at("seek").value = playback.time;
    }
    this._listFailures();
  }

  // Fields that nobody has edited have the present values.
  _beginWith({depth, heading}) {
    const [north, east] = this.now().position;
    const present = {holddepth: number(Math.max(depth, 0), 1), holdheading: String(Number(bearing(heading))), north: metres(north), east: metres(east), down: number(depth, 1), bow: String(Number(bearing(heading)))};
    for (const [id, value] of Object.entries(present))
      if (!this.edited.has(id) && document.activeElement !== at(id)) at(id).value = value;
  }

  _listFailures() {
    const failures = Object.entries(this.panel().failures || {}).filter(([, kind]) => kind !== "repaired"), key = JSON.stringify(failures);
    if (key === this.listedFailures) return;
    this.listedFailures = key;
    at("failures").replaceChildren(...failures.map(([thruster, kind]) => {
      const row = document.createElement("li"), repair = Object.assign(document.createElement("button"), {type: "button", textContent: "repair", disabled: at("fail").disabled});
      repair.addEventListener("click", () => this.act("fail", {thruster, kind: "repaired"}));
      row.append(`${thruster.replaceAll("_", " ")}: ${kind}`, repair);
      return row;
    }));
  }

  _listWaypoints() {
    const points = this.state.waypoints;
    at("waypoints").textContent = points.length ? points.map(([n, e, d], k) => `${k + 1}: ${metres(n)}, ${metres(e)}, ${number(d, 1)} m`).join(" · ")
      : "Choose “click: waypoint”, and click in the scene; drag a waypoint to move it.";
  }

  // Clicks in the scene set places on the level of the vehicle; waypoints can be dragged.
  listenToScene(scene) {
    const canvas = at("scene"), spot = event => [event.offsetX / canvas.clientWidth, event.offsetY / canvas.clientHeight];
    let dragged = -1;
    const nearest = event => this.state.waypoints.findIndex(point => {
      const shown = scene.camera.project([point[1] - scene.origin[1], -point[2], -(point[0] - scene.origin[0])]);
      return shown && Math.hypot(shown[0] * canvas.clientWidth - event.offsetX, shown[1] * canvas.clientHeight - event.offsetY) < GRABBED;
    });
    canvas.addEventListener("pointerdown", event => { dragged = nearest(event); scene.camera.blocked = dragged >= 0; if (dragged >= 0) canvas.setPointerCapture(event.pointerId); }, true);
    canvas.addEventListener("pointermove", event => {
      if (dragged < 0) return;
      const place = scene.placeAt(...spot(event), this.state.waypoints[dragged][2]);
      if (place) { this.state.waypoints[dragged] = place; this._listWaypoints(); }
    });
    canvas.addEventListener("pointerup", event => {
      const wasDragged = dragged >= 0;
      dragged = -1;
      scene.camera.blocked = false;
      if (wasDragged || scene.camera.moved > 6 || !this.clickMode || !this.now()) return;
      const place = scene.placeAt(...spot(event), this.now().position[2]);
      if (!place) return;
      if (this.clickMode === "go") this.act("go", {north: place[0], east: place[1], depth: place[2]});
      else { this.state.waypoints.push(place); this._listWaypoints(); }
    });
  }
}
