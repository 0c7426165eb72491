// Plots over time on canvases: labelled axes, a cursor at the time of the scene, a click jumps there.

import { AXES, AXIS_DASHES, LINES } from "./colours.js";
import { drawAxes, niceTicks, prepare, traceLine } from "./canvas.js";
import { indexAt } from "./scene.js";

const AXIS_NAMES = ["radial", "in_track", "cross_track"];
const MARGIN = { left: 62, right: 22, top: 40, bottom: 22 };
const MOST_LINES = 7; // one for each colour: more are not told apart

export class PlotPanel {
  constructor(container, scene, timeline) {
    this.container = container;
    this.scene = scene;
    this.timeline = timeline;
    this.plots = [];
    this.update();
  }

  // Take in what is new in the scene.
  update() {
    const described = describePlots(this.scene);
    if (described.map((plot) => plot.key).join() !== this.plots.map((plot) => plot.key).join()) {
      this.container.replaceChildren();
      this.plots = described.map((plot) => ({ ...plot, canvas: this.addCanvas(plot) }));
    } else {
      described.forEach((plot, index) => Object.assign(this.plots[index], plot));
    }
    for (const plot of this.plots) plot.picture = null;
  }

  addCanvas(plot) {
    const canvas = document.createElement("canvas");
    canvas.dataset.plot = plot.key;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", plot.title);
    canvas.addEventListener("click", (event) => {
      const width = canvas.clientWidth - MARGIN.left - MARGIN.right;
      const part = (event.offsetX - MARGIN.left) / width;
      this.timeline.seek(part * this.scene.duration);
    });
    this.container.append(canvas);
    return canvas;
  }

  draw(time) {
    for (const plot of this.plots) drawPlot(plot, time, Math.max(this.scene.duration, 1));
  }
}

function describePlots(scene) {
  const plots = [];
  const states = scene.ofKind("relative").filter((series) => series.source !== "target");
  const navigated = new Set(states.filter((s) => s.source === "estimate").map((s) => s.deputy));
  for (const series of states) {
    if (series.source === "truth" && navigated.has(series.deputy)) continue;
    const what = series.source === "estimate" ? "navigated" : "true";
    plots.push({
      key: series.name, unit: "m", lines: axisLines(series),
      title: `Position of ${series.deputy} relative to the chief, ${what}`,
    });
  }
  for (const series of scene.ofKind("relative").filter((s) => s.source === "estimate")) {
    const truth = scene.get("relative", series.deputy, "truth");
    if (truth) plots.push(errorPlot(series, truth));
  }
  const thrust = scene.ofKind("thrust");
  for (const series of thrust) {
    if (series.source === "command" && scene.get("thrust", series.deputy, "applied")) continue;
    plots.push({
      key: series.name, unit: "m/s\u00b2", lines: axisLines(series), steps: true,
      title: `Thrust acceleration of ${series.deputy}, ${series.source}`,
    });
  }
  plots.push(...satellitePlots(scene, "pierce", "vtec_tecu", "TECU", "Vertical TEC above"));
  plots.push(...satellitePlots(scene, "scintillation", "s4", "", "S4 at"));
  if (plots.length < 5) {
    plots.push(...satellitePlots(scene, "link", "cn0_dbhz", "dB-Hz", "C/N0 at").slice(0, 5 - plots.length));
  }
  return plots;
}

// A line for each axis of the chief's frame.
function axisLines(series) {
  return AXIS_NAMES.map((column, axis) => ({
    name: column.replace("_", "-"), series, column, colour: AXES[axis], dash: AXIS_DASHES[axis],
  }));
}

// Navigated minus true position where both are at the same time.
function errorPlot(estimate, truth) {
  const time = [];
  const columns = { radial: [], in_track: [], cross_track: [] };
  estimate.time.forEach((at, index) => {
    const other = truth.indexAt(at);
    if (other < 0 || Math.abs(truth.time[other] - at) > 1e-3) return;
    time.push(at);
    for (const name of AXIS_NAMES) {
      columns[name].push(estimate.columns[name][index] - truth.columns[name][other]);
    }
  });
  return {
    key: `error/${estimate.deputy}`, unit: "m", title: `Navigation error of ${estimate.deputy}`,
    lines: axisLines({ time, columns }),
  };
}

// One plot a spacecraft, a line a satellite: the longest ones, as many as colours tell apart.
function satellitePlots(scene, kind, column, unit, title) {
  const crafts = [...new Set(scene.ofKind(kind).map((series) => series.craft))];
  return crafts.map((craft) => {
    const all = scene.ofKind(kind).filter((series) => series.craft === craft
      && series.columns[column].some((value) => value !== null));
    const chosen = all.sort((a, b) => b.time.length - a.time.length || a.name.localeCompare(b.name))
      .slice(0, MOST_LINES).sort((a, b) => a.name.localeCompare(b.name));
    const count = chosen.length < all.length ? `, ${chosen.length} of ${all.length} satellites` : "";
    return {
      key: `${kind}/${craft}`, unit, title: `${title} ${craft}${count}`,
      lines: chosen.map((series, index) => ({
        name: series.satellite, series, column, colour: LINES[index], dash: index % 2 ? [5, 3] : [],
      })),
    };
  }).filter((plot) => plot.lines.length);
}

function drawPlot(plot, time, duration) {
  const { context, width, height, changed } = prepare(plot.canvas);
  if (changed || !plot.picture) plot.picture = drawLines(plot, context, width, height, duration);
  else context.putImageData(plot.picture.image, 0, 0);
  drawCursor(plot, context, time, width);
}

function drawLines(plot, context, width, height, duration) {
  const frame = { x: MARGIN.left, y: MARGIN.top, width: width - MARGIN.left - MARGIN.right,
    height: height - MARGIN.top - MARGIN.bottom };
  let [low, high] = [Infinity, -Infinity];
  for (const { series, column } of plot.lines) {
    for (const value of series.columns[column]) {
      if (value === null) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) [low, high] = [0, 1];
  const room = 0.06 * (high - low) || Math.max(Math.abs(high) * 0.05, 1e-3);
  const range = { x: [0, duration], y: [low - room, high + room] };
  context.clearRect(0, 0, width, height);
  const x = niceTicks(0, duration, 6);
  const seconds = { ...x, text: (value) => `${x.text(value)} s` };
  drawAxes(context, frame, range, { x: seconds, y: niceTicks(...range.y, 4) });
  const toX = (value) => frame.x + (value / duration) * frame.width;
  const toY = (value) => frame.y + frame.height
    - ((value - range.y[0]) / (range.y[1] - range.y[0])) * frame.height;
  context.save();
  context.beginPath();
  context.rect(frame.x, frame.y, frame.width, frame.height);
  context.clip();
  for (const line of plot.lines) traceLine(context, line, toX, toY, plot.steps);
  context.restore();
  const image = context.getImageData(0, 0, plot.canvas.width, plot.canvas.height);
  return { image, toX, toY, frame };
}

// Title, legend with the values at the cursor, and the cursor itself: they change with time.
function drawCursor(plot, context, time, width) {
  const { frame, toX } = plot.picture;
  context.fillStyle = "#1b1f24";
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "left";
  const unit = plot.unit ? ` (${plot.unit})` : "";
  context.fillText(`${plot.title}${unit}`, 8, 15);
  context.strokeStyle = "#444";
  context.lineWidth = 1;
  context.setLineDash([]);
  context.beginPath();
  context.moveTo(toX(time), frame.y);
  context.lineTo(toX(time), frame.y + frame.height);
  context.stroke();
  context.font = "11px system-ui, sans-serif";
  const room = (width - 16) / plot.lines.length;
  plot.lines.forEach((line, index) => {
    const place = 8 + index * Math.min(room, 150);
    context.strokeStyle = line.colour;
    context.lineWidth = 2.5;
    context.setLineDash(line.dash);
    context.beginPath();
    context.moveTo(place, 27);
    context.lineTo(place + 13, 27);
    context.stroke();
    const at = indexAt(line.series.time, time);
    const value = at < 0 ? null : line.series.columns[line.column][at];
    const digits = room < 100 ? 3 : 4;
    const text = room < 75 ? line.name : `${line.name} ${value === null ? "–" : format(value, digits)}`;
    context.fillText(text, place + 16, 31);
  });
  context.setLineDash([]);
}

function format(value, digits) {
  const size = Math.abs(value);
  if (size === 0) return "0";
  if (size >= 1e6 || size < 0.01) return value.toExponential(1);
  return size >= 10 ** digits ? value.toFixed(0) : value.toPrecision(digits);
}
