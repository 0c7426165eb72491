// The viewer: loads the scene, builds its parts, and moves them with the time.

import { CN0_RANGE, REGION, cividis, craftColour, css } from "./colours.js";
import { makeGlobe } from "./globe.js";
import { HillPanel } from "./hill.js";
import { GroundMap } from "./map.js";
import { PlotPanel } from "./plots.js";
import { Scene } from "./scene.js";
import { Timeline, bindControls } from "./timeline.js";

const element = (id) => document.getElementById(id);
const DRAWN_LEAST = 100; // ms: what stands still is drawn this often, as sizes may change

async function start() {
  const answer = await fetch("scene.json");
  if (!answer.ok) throw new Error(`the scene did not load: ${answer.status}`);
  const content = await answer.json();
  const scene = new Scene(content);
  const timeline = new Timeline(scene);
  const state = { scene, timeline, globe: null, errors: [] };
  window.vtff = state; // for tests, and for the curious
  document.title = `${scene.name} - vtff view`;
  element("name").textContent = scene.name;
  element("state").textContent = scene.live ? "live" : scene.notes.join("; ");
  bindControls(timeline, {
    play: element("play"), speed: element("speed"), scrub: element("scrub"), follow: element("follow"),
  }, command(scene, timeline, content.command_token));
  element("follow").hidden = !scene.live;
  const panels = [
    new HillPanel(element("hill"), scene),
    new PlotPanel(element("plots"), scene, timeline),
  ];
  state.panels = panels;
  run(state);
  if (scene.live) listen(state);
  try {
    state.globe = await makeGlobe(element("globe"), scene);
  } catch (error) {
    // The rest of the page is of use without the globe.
    element("state").textContent = `map instead of globe: ${error.message ?? error}`;
    state.errors.push(String(error));
    element("globe").hidden = true;
    element("camera").hidden = true;
    state.globe = new GroundMap(element("map"), scene);
  }
  panels.unshift(state.globe);
  state.drawn = null;
  bindCamera(state);
  drawLegend(state);
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
    showTime(scene, timeline.time);
  };
  requestAnimationFrame(frame);
}

function showTime(scene, time) {
  const scrub = element("scrub");
  scrub.max = scene.duration;
  if (document.activeElement !== scrub || Math.abs(Number(scrub.value) - time) > 1e-3) scrub.value = time;
  element("time").textContent = `${time.toFixed(1)} / ${scene.duration.toFixed(1)} s`;
  const moment = new Date((scene.startUnix + time) * 1000).toISOString();
  element("utc").textContent = scene.startUnix ? `${moment.slice(0, 10)} ${moment.slice(11, 21)} UTC` : "";
}

// Take in what a live run publishes.
function listen(state) {
  const source = new EventSource("news");
  let renewed = 0;
  source.onmessage = (event) => {
    const content = JSON.parse(event.data);
    if (content.reset) state.scene.series.clear(); // a replay went back
    state.scene.merge(content);
    element("state").textContent = content.series.length ? "live" : "live: nothing new";
    // Lines over all samples are renewed less often than positions move.
    const now = performance.now();
    if (content.series.length && now - renewed > 900) {
      renewed = now;
      for (const panel of state.panels) panel.update();
      state.drawn = null;
      drawLegend(state);
    }
  };
  source.onerror = () => {
    element("state").textContent = "the run or its viewer has ended";
  };
}

// In a live scene the controls also move a replay that runs: vtff replay.
function command(scene, timeline, token) {
  const post = (name, value) => {
    if (!scene.live) return;
    const body = JSON.stringify({ command: name, value: value ?? 0 });
    const headers = { "X-Vtff-Token": token }; // shows the server that its own page asks
    fetch("command", { method: "POST", body, headers }).then((answer) => answer.json())
      .then(({ message }) => { element("state").textContent = message; }, () => {});
  };
  element("play").addEventListener("click", () => post(timeline.playing ? "resume" : "pause"));
  return post;
}

function bindCamera(state) {
  for (const button of document.querySelectorAll("[data-camera]")) {
    if (button.dataset.camera === "region") button.hidden = !state.scene.regions.length;
    button.addEventListener("click", () => state.globe.look(button.dataset.camera));
  }
}

function drawLegend(state) {
  const legend = element("legend");
  const rows = state.scene.spacecraft().map((craft, index) => {
    const dash = index ? "dashed" : "solid";
    return row(`${craft}: orbit, ground track`, swatch(craftColour(index), dash));
  });
  rows.push(row(`C/N0 ${CN0_RANGE[0]} to ${CN0_RANGE[1]} dB-Hz`, scale()));
  if (state.globe?.tecRange) {
    const [low, high] = state.globe.tecRange;
    rows.push(row(`vertical TEC ${low.toFixed(1)} to ${high.toFixed(1)} TECU`, scale()));
  }
  for (const region of state.scene.regions) {
    rows.push(row(`${region.name.replaceAll("_", " ")}, S4 ${region.s4}`, swatch(REGION, "solid")));
  }
  legend.replaceChildren(...rows);
}

function row(text, mark) {
  const line = document.createElement("div");
  line.append(mark, text);
  return line;
}

function swatch(colour, style) {
  const mark = document.createElement("span");
  mark.className = "swatch";
  mark.style.borderTopColor = colour;
  mark.style.borderTopStyle = style;
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
  console.error(error);
});
