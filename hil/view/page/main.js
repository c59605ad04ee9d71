// The page: takes what the view sends, shows it, and sends what the hands and buttons do.
import {angles} from "./math.js";
import {isNew, number, write} from "./format.js";
import {hudTexts, putHud} from "./hud.js";
import {putOverlay} from "./overlay.js";
import {Buttons} from "./buttons.js";
import {Layout} from "./layout.js";
import {DelayLine, Log, showHealth, showNumbers, showThrusters} from "./panels.js";
import {Parts} from "./parts.js";
import {Pictures} from "./pictures.js";
import {Scene} from "./scene.js";
import {Sticks} from "./sticks.js";
import {COLOURS, readContent} from "./world.js";

const at = id => document.getElementById(id);
const STICK_MS = 50, PANEL_MS = 150, RETRY_MS = 1000, INSET_MS = 65, HUD_MS = 45;

const state = {values: {}, stick: {}, waypoints: [], acts: []};
let scene = null, content = {vehicles: {}, sensors: {}, world: null, path: []}, stickSocket = null, waiting = 0;
const log = new Log(), delays = new DelayLine(), sticks = new Sticks();
const pictures = new Pictures(at("picture"), (header, image) => {
  if (header.kind === "sonar" && scene) scene.setFan(header.vehicle, header.sensor, image, header);
});
const parts = new Parts(at("hud")), layout = new Layout(pictures, parts, () => scene);
const chosen = () => at("vehicle").value;
const panel = () => state.values[`panel/${chosen()}`] || {};
const now = () => state.values.motion?.[chosen()];
const act = (what, more = {}) => state.acts.push({do: what, ...more});
const buttons = new Buttons({act, state, chosen, panel, now, scene: () => scene, content: () => content});

function address(name) { return location.href.replace(/^http/, "ws").replace(/[^/]*$/, name); }

function openLive() {
  const socket = new WebSocket(address("live"));
  socket.binaryType = "arraybuffer";
  let isFirst = true;
  socket.onmessage = ({data}) => {
    if (typeof data !== "string") { pictures.take(data); return; }
    const {log: lines, values} = JSON.parse(data);
    if (isFirst) { log.clear(); state.values = {}; isFirst = false; }
    Object.assign(state.values, values);
    log.add(lines);
    take(values);
    socket.send(JSON.stringify({vehicle: chosen(), pictures: layout.wanted()}));
  };
  socket.onclose = () => setTimeout(openLive, RETRY_MS);
}

function take(values) {  // what has just come
  if (!scene) return;
  for (const [key, value] of Object.entries(values)) {
    const [kind, name] = key.split("/");
    if (kind === "motion") { for (const [each, motion] of Object.entries(value)) if (motion) scene.move(each, motion); }
    else if (kind === "track") scene.setTrack(name, value);
    else if (kind === "tether" && (value.length || scene.free.has(key))) scene.setLine(key, value, COLOURS.tether, 2);
    else if (kind === "plan") scene.setLine(Object.keys(content.vehicles).length > 1 ? `path/${name}` : "path", value, COLOURS.path, 2.5);
    else if (kind === "scans") { for (const [sensor, points] of Object.entries(value)) scene.setScan(name, sensor, points); }
    else if (kind === "hunt") {
      const places = Object.values(state.values.motion || {}).filter(Boolean).map(each => each.position), reach = content.hunt.reach;
      const near = places.flatMap((one, k) => places.slice(k + 1).filter(two => Math.hypot(one[0] - two[0], one[1] - two[1]) < reach).flatMap(two => [one, two]));
      scene.setLine("links", near, COLOURS.link, 2, false);
      scene.setLine("places", value.flatMap(([n, e, d]) => [[n, e, d - 0.3], [n, e, d + 0.3]]), COLOURS.place, 8, false);
    }
  }
  scene.select(chosen());
}

function openStick() {
  stickSocket = new WebSocket(address("stick"));
  stickSocket.onmessage = event => { waiting = 0; state.stick = JSON.parse(event.data); buttons.allow(state.stick, sticks); };
  stickSocket.onclose = () => {
    state.stick = {};
    buttons.allow({text: "the view has ended, or the network is down; trying again"}, sticks);
    waiting = 0;
    setTimeout(openStick, RETRY_MS);
  };
}

setInterval(() => {
  if (stickSocket.readyState !== WebSocket.OPEN || waiting > 3) return;  // each message is answered, so none queue up on a slow link
  waiting += 1;
  stickSocket.send(JSON.stringify({vehicle: chosen(), ...sticks.read(), acts: state.acts.splice(0), mode: at("mode").value,
                                   hold_depth: at("depth").checked, hold_heading: at("heading").checked}));
}, STICK_MS);

function reading() {  // what the instruments show of the chosen vehicle; null before its first sample
  const motion = now();
  if (!motion) return null;
  const {depth, heading, speed} = panel().target || {};
  const target = {depth, speed, heading: heading == null ? null : heading * 180 / Math.PI};
  return {...angles(motion.attitude), depth: motion.position[2], speed: Math.hypot(...motion.nu.slice(0, 3)), altitude: panel().altitude,
          target, texts: hudTexts({panel: panel(), now: motion, world: content.world, time: state.values.playback?.time})};
}

function showPanels() {
  const see = reading(), file = content.vehicles[chosen()] || Object.values(content.vehicles)[0], playback = state.values.playback;
  if (see) {
    showNumbers(see, panel(), now().position);
    showThrusters(file, now().thrusts, panel().pwm || [], Object.fromEntries(Object.entries(panel().failures || {}).filter(([, kind]) => kind !== "repaired")));
  }
  delays.add(panel().delay);
  if (at("health").closest("details").open) showHealth(panel().delay, state.values[`figures/${chosen()}`]);
  buttons.show({file, see, playback, recording: state.values.recording});
  write("factor", playback ? `time × ${playback.paused ? 0 : playback.speed}` : panel().factor ? `real time × ${number(panel().factor, 2)}` : "");
  write("delay", panel().delay ? `delay ${number(panel().delay.median, 1)} ms` : "");
  write("armed", panel().armed == null ? "" : panel().armed ? "armed" : "disarmed");
  if (isNew("armed as", panel().armed)) at("armed").className = `chip ${panel().armed ? "ok" : "bad"}`;
  layout.offer(state.values[`pictures/${chosen()}`] || [], content.sensors);
}

function hud() {
  const box = at("hud"), {clientWidth: width, clientHeight: height} = box, see = reading(), isScene = layout.main === "scene";
  const stick = at("leftstick").offsetHeight, lift = stick && stick + 16, inset = document.querySelector(".panel.small:not(.gone)");
  const right = !lift && inset?.offsetTop > height / 2 ? width - inset.offsetLeft : 0;  // pixels that the small picture covers at the lower right
  if (isScene && scene) putOverlay(parts, width, height, {lift, right}, scene, {waypoints: state.waypoints, target: panel().target?.places || [],
                                                                 live: name => name !== chosen() || panel().present !== false});
  const isEye = isScene ? scene?.camera.mode === "eye" : !layout.isSonar();
  const isOn = Boolean(see && layout.layers.hud && !(isScene && !isEye && width < 560));
  box.classList.toggle("on", isOn && !isScene && isEye);
  if (isOn) putHud(parts, width, height, lift, see, isEye);
  parts.sweep();
}

let lastHud = 0, lastScene = 0;
function frame(time) {
  requestAnimationFrame(frame);
  scene?.adapt(time);
  if (scene && layout.isShown("scene") && (layout.main === "scene" || time - lastScene > INSET_MS)) {
    lastScene = time;
    scene.isPaused = Boolean(state.values.playback?.paused);
    scene.draw(time);
  }
  if (layout.isShown("picture")) layout.tellEmpty(pictures.draw(layout.sensor, layout.main !== "picture"), Boolean(now()));
  else layout.tellEmpty(true, Boolean(now()));
  if (time - lastHud > HUD_MS) { lastHud = time; hud(); }
}

async function start() {
  const answer = await fetch("content");
  content = readContent(await answer.arrayBuffer());
  layout.begin(content);
  buttons.begin(content);
  try { scene = new Scene(at("scene"), content); buttons.listenToScene(scene); window.sceneOfPage = scene; } catch (error) { log.add([["", "error", error.message]]); }
  layout.applyLayers();
  take(state.values);
  requestAnimationFrame(frame);
}

at("vehicle").addEventListener("change", () => { pictures.forget(); state.waypoints = []; buttons.forget(); scene?.select(chosen()); });
setInterval(showPanels, PANEL_MS);
openLive();
openStick();
start();
