// The viewer: loads the scene, builds its parts, and moves them with the time.

import { Capture } from "./capture.js";
import { BESIDE, REGION, WALL, cividis, craftColour, css, onPageChange } from "./colours.js";
import { format } from "./canvas.js";
import { makeGlobe } from "./globe.js";
import { HillPanel } from "./hill.js";
import { GroundMap } from "./map.js";
import { PlotPanel } from "./plots.js";
import { Scene } from "./scene.js";
import { Timeline, bindControls, bindKeys, drawMarks } from "./timeline.js";

const element = (id) => document.getElementById(id);
const DRAWN_LEAST = 100; // ms: what stands still is drawn this often, as sizes may change
const CAMERAS = ["earth", "links", "chief", "formation", "region"];
const MAP_CAMERAS = ["earth", "formation"]; // where there is no globe
const QUANTITIES = { cn0_dbhz: ["C/N0", "dB-Hz", 0], s4: ["S4", "", 1], vtec_tecu: ["vertical TEC", "TECU", 1] };

async function start() {
  const content = await load();
  const scene = new Scene(content);
  const timeline = new Timeline(scene);
  const state = { scene, timeline, globe: null, errors: [], camera: "earth" };
  window.vtff = state; // for tests, and for the curious
  document.title = `${scene.name} - vtff view`;
  element("name").textContent = scene.beside ? `${scene.name} beside ${scene.beside.name}` : scene.name;
  element("state").textContent = scene.live ? "live" : scene.notes.join("; ");
  bindControls(timeline, {
    play: element("play"), speed: element("speed"), scrub: element("scrub"), follow: element("follow"),
  }, command(scene, content.command_token));
  element("follow").hidden = !scene.live;
  const plots = new PlotPanel(element("plots"), scene, timeline);
  // A spacecraft that flies alone has no formation to show: the globe takes the place.
  const alone = !scene.live && !scene.deputies().length && scene.ofKind("attitude").length > 0;
  document.querySelector("main").classList.toggle("alone", alone);
  const hill = new HillPanel(element("hill"), scene, () => plots.window);
  const panels = [hill, plots];
  Object.assign(state, { panels, plots, hill });
  state.capture = new Capture(document.querySelector("main"), () => describe(state), () => state.panels);
  onPageChange(() => {
    for (const panel of state.panels) panel.update();
    state.drawn = null;
  });
  drawMarks(element("marks"), timeline);
  bindTools(state);
  bindKeys(timeline, {
    "+": () => plots.zoom(0.5, timeline.time),
    "-": () => plots.zoom(2, timeline.time),
    0: () => plots.show(null),
    s: () => state.capture.savePicture(scene.name),
    "?": () => element("keys").showModal(),
    ...Object.fromEntries(CAMERAS.map((camera, index) => [index + 1, () => look(state, camera)])),
  });
  run(state);
  if (scene.live) listen(state);
  try {
    state.globe = scene.exported ? makeMap(scene) : await makeGlobe(element("globe"), scene);
  } catch (error) {
    // The rest of the page is of use without the globe.
    element("state").textContent = `map instead of globe: ${error.message ?? error}`;
    state.errors.push(String(error));
    state.globe = makeMap(scene);
  }
  panels.unshift(state.globe);
  state.drawn = null;
  bindCamera(state);
  restore(state, location.hash);
  drawLegend(state);
}

function makeMap(scene) {
  element("globe").hidden = true;
  for (const button of document.querySelectorAll("[data-camera]")) {
    button.hidden = !MAP_CAMERAS.includes(button.dataset.camera);
    if (button.dataset.camera === "earth") {
      button.textContent = "Map";
      button.title = "Map of the ground tracks (1)";
    }
  }
  return new GroundMap(element("map"), scene);
}

// The scene from the page itself, if it is an exported file, else from the server, with progress.
async function load() {
  const bar = element("loading");
  const inside = element("scene");
  if (inside) {
    bar.remove();
    return JSON.parse(inside.textContent);
  }
  const answer = await fetch("scene.json");
  if (!answer.ok) throw new Error(`the scene did not load: ${answer.status}`);
  const length = Number(answer.headers.get("Content-Length"));
  const parts = [];
  let taken = 0;
  for (const reader = answer.body.getReader(); ;) {
    const { done, value } = await reader.read();
    if (done) break;
    parts.push(value);
    taken += value.length;
    if (length) bar.value = taken / length;
    element("state").textContent = `loading ${(taken / 1e6).toFixed(1)} MB`;
  }
  bar.remove();
  return JSON.parse(await new Blob(parts).text());
}

function describe({ scene, timeline }) {
  const moment = scene.startUnix ? `, ${new Date((scene.startUnix + timeline.time) * 1000).toISOString()}` : "";
  return `${scene.name}, ${timeline.time.toFixed(1)} s${moment}`;
}

// Draw each frame, and while nothing moves now and then.
function run(state) {
  let last = -Infinity;
  const frame = (now) => {
    requestAnimationFrame(frame);
    const { timeline, scene } = state;
    timeline.advance(now);
    if (timeline.time === state.drawn && now - last < DRAWN_LEAST) return;
    last = now;
    state.drawn = timeline.time;
    for (const panel of state.panels) panel.draw(timeline.time);
    showTime(scene, timeline);
  };
  requestAnimationFrame(frame);
}

function showTime(scene, timeline) {
  const { time, trueRate } = timeline;
  const scrub = element("scrub");
  scrub.max = scene.duration;
  if (document.activeElement !== scrub || Math.abs(Number(scrub.value) - time) > 1e-3) scrub.value = time;
  element("time").textContent = `${time.toFixed(1)} / ${scene.duration.toFixed(1)} s`;
  element("rate").textContent = trueRate === null ? "" : `measured ${format(trueRate, 3)}×`;
  const moment = new Date((scene.startUnix + time) * 1000).toISOString();
  element("utc").textContent = scene.startUnix ? `${moment.slice(0, 10)} ${moment.slice(11, 21)} UTC` : "";
}

const RENEWAL = 900; // ms between drawings of all lines of a live scene

// Take in what a live run publishes.
function listen(state) {
  const source = new EventSource("news");
  let renewed = -Infinity;
  let waiting = 0;
  const renew = () => {
    waiting = 0;
    renewed = performance.now();
    for (const panel of state.panels) panel.update();
    state.drawn = null;
    drawLegend(state);
  };
  source.onmessage = (event) => {
    const content = JSON.parse(event.data);
    if (content.reset) state.scene.series.clear(); // a replay went back
    const events = state.scene.events.length;
    state.scene.merge(content);
    element("state").textContent = content.series.length ? "live" : "live: nothing new";
    // Lines over all samples are renewed less often than positions move; the last news too.
    if (content.series.length && !waiting) {
      waiting = setTimeout(renew, Math.max(0, RENEWAL - (performance.now() - renewed)));
    }
    if (state.scene.events.length !== events) drawMarks(element("marks"), state.timeline);
  };
  source.onerror = () => {
    element("state").textContent = "the run or its viewer has ended";
  };
}

// In a live scene the controls also move a replay that runs: vtff replay.
function command(scene, token) {
  return (name, value) => {
    if (!scene.live) return;
    const body = JSON.stringify({ command: name, value: value ?? 0 });
    const headers = { "X-Vtff-Token": token }; // shows the server that its own page asks
    fetch("command", { method: "POST", body, headers }).then((answer) => answer.json())
      .then(({ message }) => { element("state").textContent = message; }, () => {});
  };
}

function bindTools(state) {
  const { scene } = state;
  element("picture").addEventListener("click", () => state.capture.savePicture(scene.name));
  element("video").addEventListener("click", () => {
    state.capture.toggleVideo(scene.name);
    element("video").setAttribute("aria-pressed", String(state.capture.recording));
  });
  element("help").addEventListener("click", () => element("keys").showModal());
  element("link").addEventListener("click", () => {
    history.replaceState(null, "", address(state));
    const done = () => { element("state").textContent = "the address of this view is in the address bar"; };
    navigator.clipboard?.writeText(location.href).then(
      () => { element("state").textContent = "address of this view copied"; }, done,
    ) ?? done();
  });
}

// What an address tells after #: time, camera, colour of the links, and times that the plots show.
function address({ timeline, camera, globe, plots }) {
  const values = { t: timeline.time.toFixed(1), camera, colour: globe.quantity };
  if (plots.window) values.plots = plots.window.map((time) => time.toFixed(1)).join("-");
  return `#${new URLSearchParams(values)}`;
}

function restore(state, hash) {
  const values = new URLSearchParams(hash.slice(1));
  const time = Number.parseFloat(values.get("t"));
  if (Number.isFinite(time)) state.timeline.seek(time);
  const shown = (values.get("plots") ?? "").split("-").map(Number);
  if (shown.length === 2 && shown.every(Number.isFinite) && shown[0] < shown[1]) state.plots.show(shown);
  if (values.get("colour") in QUANTITIES) {
    element("colour").value = values.get("colour");
    state.globe.colourBy(values.get("colour"));
  }
  look(state, "earth");
  if (CAMERAS.includes(values.get("camera"))) look(state, values.get("camera"));
}

function look(state, camera) {
  if (!state.globe || document.querySelector(`[data-camera="${camera}"]`).hidden) return;
  state.camera = camera;
  state.globe.look(camera);
  for (const button of document.querySelectorAll("[data-camera]")) {
    button.setAttribute("aria-pressed", String(button.dataset.camera === camera));
  }
  element("legend").hidden = camera === "formation";
  state.drawn = null;
}

function bindCamera(state) {
  for (const button of document.querySelectorAll("[data-camera]")) {
    if (button.dataset.camera === "formation" && !state.scene.deputies().length && state.scene.ofKind("attitude").length) {
      button.textContent = "Attitude";
      button.title = "The spacecraft in its RTN frame, with its body axes (4)";
    }
    if (button.dataset.camera === "region") button.hidden = element("globe").hidden || !state.scene.regions.length;
    button.addEventListener("click", () => look(state, button.dataset.camera));
  }
  const colour = element("colour");
  colour.hidden = !state.scene.ofKind("link").length && !state.scene.live;
  colour.querySelector("[value=s4]").hidden = !state.scene.ofKind("scintillation").length && !state.scene.live;
  colour.querySelector("[value=vtec_tecu]").hidden = !state.scene.ofKind("pierce").length && !state.scene.live;
  colour.addEventListener("change", () => {
    state.globe.colourBy(colour.value);
    state.drawn = null;
    drawLegend(state);
  });
}

function drawLegend(state) {
  const { scene, globe } = state;
  const rows = scene.spacecraft().map((craft, index) => {
    const dash = index ? "dashed" : "solid";
    return row(`${craft}: orbit, ground track`, swatch(craftColour(index), dash));
  });
  if (scene.beside) rows.push(row(`grey in the plots: ${scene.beside.name}`, swatch(BESIDE, "solid")));
  const quantity = globe?.quantity ?? "cn0_dbhz";
  const [name, unit, decimals] = QUANTITIES[quantity];
  const [from, to] = globe?.colourRange ?? [30, 50];
  rows.push(row(`links: ${name} ${from.toFixed(decimals)} to ${to.toFixed(decimals)} ${unit}`, scale()));
  if (globe?.tecRange) {
    const [low, high] = globe.tecRange;
    rows.push(row(`on the ground track: vertical TEC ${low.toFixed(1)} to ${high.toFixed(1)} TECU`, scale()));
  }
  for (const region of scene.regions) {
    rows.push(row(`${region.name.replaceAll("_", " ")}, S4 ${region.s4}`, swatch(REGION, "solid")));
  }
  if (scene.ofKind("boundary").length) rows.push(row("edges that were found", swatch(REGION, "dot")));
  if (scene.ofKind("wall").length) rows.push(row("walls as the survey knows them", swatch(WALL, "solid")));
  if (scene.dipEquator.length) rows.push(row("dip equator", swatch("#9aa4af", "dashed")));
  element("legend").replaceChildren(...rows);
}

function row(text, mark) {
  const line = document.createElement("div");
  line.append(mark, text);
  return line;
}

function swatch(colour, style) {
  const mark = document.createElement("span");
  mark.className = style === "dot" ? "swatch dot" : "swatch";
  mark.style.borderColor = colour;
  if (style !== "dot") mark.style.borderTopStyle = style;
  return mark;
}

function scale() {
  const canvas = document.createElement("canvas");
  canvas.width = 120;
  canvas.height = 10;
  const context = canvas.getContext("2d");
  for (let x = 0; x < canvas.width; x += 1) {
    context.fillStyle = css(cividis(x / (canvas.width - 1)));
    context.fillRect(x, 0, 1, canvas.height);
  }
  return canvas;
}

window.addEventListener("error", (event) => window.vtff?.errors.push(event.message));
start().catch((error) => {
  element("state").textContent = String(error.message ?? error);
  element("loading")?.remove();
  console.error(error);
});
