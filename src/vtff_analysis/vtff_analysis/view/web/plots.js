// Plots over time on canvases. All share the times that are shown: the wheel and a drag zoom, a
// double click shows everything, a click goes to its time, hovering tells the values there.

import { AXIS_DASHES, BESIDE, page } from "./colours.js";
import { drawAxes, drawTip, format, niceTicks, prepare, traceLine } from "./canvas.js";
import { indexAt } from "./scene.js";

const AXIS_NAMES = ["radial", "in_track", "cross_track"];
const MARGIN = { left: 62, right: 22, top: 40, bottom: 22 };
const MOST_LINES = 7; // one for each colour: more are not told apart
const SHORTEST_WINDOW = 2; // s
const DRAG_LEAST = 6; // pixels: less is a click
const DIGITS = 6; // of values at the cursor: a micrometre in a metre

export class PlotPanel {
  constructor(container, scene, timeline) {
    this.container = container;
    this.scene = scene;
    this.timeline = timeline;
    this.plots = [];
    this.window = null; // [from, to] in s; null: everything
    this.hover = null; // { plot, x, y }
    this.drag = null; // { plot, from, to } in pixels
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
    this.renew();
  }

  renew() {
    for (const plot of this.plots) plot.picture = null;
  }

  // Times that are shown, s.
  get range() {
    return this.window ?? [0, Math.max(this.scene.duration, 1)];
  }

  // Show only some times; null shows all.
  show(window) {
    if (window) {
      const all = Math.max(this.scene.duration, 1);
      const width = Math.min(Math.max(window[1] - window[0], SHORTEST_WINDOW), all);
      const from = Math.min(Math.max(window[0], 0), all - width);
      this.window = width >= all ? null : [from, from + width];
    } else {
      this.window = null;
    }
    this.renew();
    this.timeline.changed();
  }

  zoom(factor, about) {
    const [from, to] = this.range;
    this.show([about - (about - from) * factor, about + (to - about) * factor]);
  }

  addCanvas(plot) {
    const canvas = document.createElement("canvas");
    canvas.dataset.plot = plot.key;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", plot.title);
    if (plot.profile) { // has no axis of time
      canvas.className = "profile";
      this.container.append(canvas);
      return canvas;
    }
    const toTime = (x) => {
      const [from, to] = this.range;
      const part = (x - MARGIN.left) / (canvas.clientWidth - MARGIN.left - MARGIN.right);
      return from + Math.min(Math.max(part, 0), 1) * (to - from);
    };
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      canvas.setPointerCapture(event.pointerId);
      this.drag = { canvas, from: event.offsetX, to: event.offsetX };
    });
    canvas.addEventListener("pointermove", (event) => {
      this.hover = { canvas, x: event.offsetX, y: event.offsetY };
      if (this.drag?.canvas === canvas) this.drag.to = event.offsetX;
    });
    canvas.addEventListener("pointerup", () => {
      const drag = this.drag;
      this.drag = null;
      if (!drag) return;
      const ends = [toTime(drag.from), toTime(drag.to)].sort((a, b) => a - b);
      if (Math.abs(drag.to - drag.from) < DRAG_LEAST) this.timeline.seek(toTime(drag.to));
      else this.show(ends);
    });
    canvas.addEventListener("pointercancel", () => { this.drag = null; });
    canvas.addEventListener("pointerleave", () => { this.hover = null; });
    canvas.addEventListener("dblclick", () => this.show(null));
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.shiftKey && event.deltaY > 0 && !this.window) return; // scrolls
      event.preventDefault();
      this.zoom(event.deltaY > 0 ? 1.25 : 0.8, toTime(event.offsetX));
    }, { passive: false });
    this.container.append(canvas);
    return canvas;
  }

  draw(time) {
    if (this.window && this.timeline.moving && (time < this.window[0] || time > this.window[1])) {
      const width = this.window[1] - this.window[0]; // the time that plays stays in view
      this.window = [Math.max(0, time - 0.1 * width), Math.max(0, time - 0.1 * width) + width];
      this.renew();
    }
    const range = this.range;
    const hovered = this.hover;
    for (const plot of this.plots) {
      const drag = this.drag?.canvas === plot.canvas ? this.drag : null;
      drawPlot(plot, time, range, hovered, drag);
    }
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
      key: series.name, unit: "m",
      lines: [...besideLines(scene.beside?.series.get(series.name)), ...axisLines(series)],
      title: `Position of ${series.deputy} relative to the chief, ${what}`,
    });
  }
  for (const series of scene.ofKind("relative").filter((s) => s.source === "estimate")) {
    const plot = errorPlot(scene, series);
    if (!plot) continue;
    const other = scene.beside?.series.get(series.name);
    const beside = other ? errorPlot(scene.beside, other) : null;
    if (beside) plot.lines.unshift(...besideLines(beside.errors));
    plots.push(plot);
  }
  const thrust = scene.ofKind("thrust");
  for (const series of thrust) {
    if (series.source === "command" && scene.get("thrust", series.deputy, "applied")) continue;
    plots.push({
      key: series.name, unit: "m/s\u00b2", lines: axisLines(series), steps: true,
      title: `Thrust acceleration of ${series.deputy}, ${series.source}`,
    });
  }
  for (const series of scene.ofKind("attitude")) plots.push(...attitudePlots(scene, series));
  for (const series of scene.ofKind("density")) plots.push(densityPlot(series), profilePlot(series));
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
    name: column.replace("_", "-"), series, column, colour: page().axes[axis], dash: AXIS_DASHES[axis],
  }));
}

// The same of the second run, grey behind the first.
function besideLines(series) {
  return series ? AXIS_NAMES.map((column, axis) => ({
    series, column, colour: BESIDE, dash: AXIS_DASHES[axis], beside: true,
  })) : [];
}

// Navigated minus true position where both are at the same time.
function errorPlot(scene, estimate) {
  const truth = scene.get("relative", estimate.deputy, "truth");
  if (!truth) return null;
  const time = [];
  const columns = { radial: [], in_track: [], cross_track: [] };
  estimate.time.forEach((at, index) => {
    const other = truth.indexAt(at);
    if (other < 0 || Math.abs(truth.time[other] - at) > 1e-3) return;
    time.push(at);
    for (const name of AXIS_NAMES) {
      columns[name].push(1e3 * (estimate.columns[name][index] - truth.columns[name][other]));
    }
  });
  const errors = { time, columns };
  return {
    key: `error/${estimate.deputy}`, unit: "mm", title: `Navigation error of ${estimate.deputy}`,
    lines: axisLines(errors), errors,
  };
}

// Angles to the orbit axes, rates and wheel of a spacecraft; of the estimate only the angles where
// the truth is there too.
function attitudePlots(scene, series) {
  const lines = (names) => names.map((name, index) => ({
    name: name.replace(/_deg$/, "").replace("_", " "), series, column: name,
    colour: page().axes[index], dash: AXIS_DASHES[index],
  }));
  const of = `of ${series.craft}, ${series.source === "truth" ? "true" : "estimated"}`;
  const angles = {
    key: `${series.name}/angles`, unit: "deg", title: `Roll, pitch, yaw ${of}`,
    lines: lines(["roll_deg", "pitch_deg", "yaw_deg"]),
  };
  if (series.source !== "truth" && scene.get("attitude", series.craft, "truth")) return [angles];
  return [
    angles,
    { key: `${series.name}/rates`, unit: "deg/s", title: `Rates ${of}`,
      lines: lines(["rate_x_deg", "rate_y_deg", "rate_z_deg"]) },
    { key: `${series.name}/wheel`, unit: "rpm", title: `Speed of the wheel ${of}`, lines: lines(["wheel_rpm"]) },
  ];
}

// Electron density on the way of the pair, with its stated sigma as a band of two thin lines.
function densityPlot(series) {
  const { per_cm3: density, sigma } = series.columns;
  const edge = (sign) => ({ time: series.time,
    columns: { edge: density.map((value, i) => (value === null ? null : value + sign * sigma[i])) } });
  const [blue, , green] = page().axes;
  return {
    key: series.name, unit: "1/cm\u00b3", title: `Electron density at chief and ${series.deputy}`,
    lines: [
      { name: "density", series, column: "per_cm3", colour: blue, dash: [] },
      { name: "+1 sigma", series: edge(1), column: "edge", colour: green, dash: [2, 3] },
      { name: "-1 sigma", series: edge(-1), column: "edge", colour: green, dash: [2, 3] },
    ],
  };
}

// The same density over altitude, up to the time of the scene.
function profilePlot(series) {
  return {
    key: `profile/${series.deputy}`, profile: series, lines: [],
    title: `Electron density over altitude, chief and ${series.deputy}, so far`,
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
        name: series.satellite, series, column, colour: page().lines[index],
        dash: index % 2 ? [5, 3] : [],
      })),
    };
  }).filter((plot) => plot.lines.length);
}

function drawProfile(plot, time) {
  const { context, width, height } = prepare(plot.canvas);
  const colours = page();
  const { time: times, columns } = plot.profile;
  const frame = { x: MARGIN.left, y: 24, width: width - MARGIN.left - MARGIN.right, height: height - 24 - 36 };
  const used = times.map((_, index) => index).filter((index) => columns.per_cm3[index] !== null);
  const limits = (values) => {
    let [low, high] = [Infinity, -Infinity];
    for (const value of values) [low, high] = [Math.min(low, value), Math.max(high, value)];
    const room = 0.05 * (high - low) || 1;
    return low <= high ? [low - room, high + room] : [0, 1];
  };
  const kilometres = columns.altitude.map((value) => value / 1e3);
  const range = { x: limits(used.map((i) => columns.per_cm3[i])), y: limits(used.map((i) => kilometres[i])) };
  context.clearRect(0, 0, width, height);
  const ticks = { x: niceTicks(...range.x, width < 450 ? 3 : 5), y: niceTicks(...range.y, 4) };
  ticks.x.text = (value) => value.toExponential(1);
  const { toX, toY } = drawAxes(context, frame, range, ticks, { x: "1/cm\u00b3", y: "altitude (km)" });
  context.save();
  context.beginPath();
  context.rect(frame.x, frame.y, frame.width, frame.height);
  context.clip();
  for (const index of used) {
    if (times[index] > time) break;
    const [x, y] = [toX(columns.per_cm3[index]), toY(kilometres[index])];
    context.strokeStyle = colours.past;
    const wide = Math.abs(toX(range.x[0] + (columns.sigma[index] ?? 0)) - toX(range.x[0]));
    context.beginPath();
    context.moveTo(x - wide, y);
    context.lineTo(x + wide, y);
    context.stroke();
    context.fillStyle = colours.axes[0];
    context.fillRect(x - 1.5, y - 1.5, 3, 3);
  }
  context.restore();
  context.fillStyle = colours.ink;
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "left";
  context.fillText(`${plot.title} (bars: 1 sigma)`, 8, 15, width - 16);
}

function drawPlot(plot, time, range, hover, drag) {
  if (plot.profile) {
    drawProfile(plot, time);
    return;
  }
  const { context, width, height, changed } = prepare(plot.canvas);
  if (changed || !plot.picture) plot.picture = drawLines(plot, context, width, height, range);
  else context.putImageData(plot.picture.image, 0, 0);
  const { frame, toX, toTime } = plot.picture;
  const hoverTime = hover && hover.canvas.clientWidth === width ? toTime(hover.x) : null;
  drawCursor(plot, context, time, width, hoverTime);
  if (drag && Math.abs(drag.to - drag.from) >= DRAG_LEAST) {
    context.fillStyle = "rgba(0, 114, 178, .2)";
    context.fillRect(Math.min(drag.from, drag.to), frame.y, Math.abs(drag.to - drag.from), frame.height);
  } else if (hover?.canvas === plot.canvas && hoverTime !== null) {
    const texts = valuesAt(plot, hoverTime).map(({ line, value }) => `${line.name} ${format(value, DIGITS)}`);
    drawTip(context, toX(hoverTime), hover.y, [`${format(hoverTime, DIGITS)} s`, ...texts], width, height);
  }
}

function drawLines(plot, context, width, height, [from, to]) {
  const frame = { x: MARGIN.left, y: MARGIN.top, width: width - MARGIN.left - MARGIN.right,
    height: height - MARGIN.top - MARGIN.bottom };
  const [low, high] = visibleRange(plot.lines, from, to);
  const room = 0.06 * (high - low) || Math.max(Math.abs(high) * 0.05, 1e-3);
  const range = { x: [from, to], y: [low - room, high + room] };
  context.clearRect(0, 0, width, height);
  const x = niceTicks(from, to, width < 450 ? 3 : 6);
  const seconds = { ...x, text: (value) => `${x.text(value)} s` };
  const { toX, toY } = drawAxes(context, frame, range, { x: seconds, y: niceTicks(...range.y, 4) });
  context.save();
  context.beginPath();
  context.rect(frame.x, frame.y, frame.width, frame.height);
  context.clip();
  for (const line of plot.lines) traceLine(context, line, toX, toY, plot.steps);
  context.restore();
  const image = context.getImageData(0, 0, plot.canvas.width, plot.canvas.height);
  const toTime = (pixel) => {
    const time = from + ((pixel - frame.x) / frame.width) * (to - from);
    return time < from || time > to ? null : time;
  };
  return { image, toX, toY, toTime, frame, range };
}

// Smallest and largest value between two times, with the samples that hold at their begin.
function visibleRange(lines, from, to) {
  let [low, high] = [Infinity, -Infinity];
  for (const { series, column } of lines) {
    const last = indexAt(series.time, to);
    for (let index = Math.max(indexAt(series.time, from), 0); index <= last; index += 1) {
      const value = series.columns[column][index];
      if (value === null) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return low <= high ? [low, high] : [0, 1];
}

function valuesAt(plot, time) {
  return plot.lines.filter((line) => !line.beside).map((line) => {
    const at = indexAt(line.series.time, time);
    return { line, value: at < 0 ? null : line.series.columns[line.column][at] };
  });
}

// Title, legend with the values at the cursor, and the cursor itself: they change with time.
function drawCursor(plot, context, time, width, hoverTime) {
  const { frame, toX, range } = plot.picture;
  const colours = page();
  context.fillStyle = colours.ink;
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "left";
  const unit = plot.unit ? ` (${plot.unit})` : "";
  context.fillText(`${plot.title}${unit}`, 8, 15, width - 16);
  context.lineWidth = 1;
  context.setLineDash([]);
  const upright = (at, colour) => {
    if (at < range.x[0] || at > range.x[1]) return;
    context.strokeStyle = colour;
    context.beginPath();
    context.moveTo(toX(at), frame.y);
    context.lineTo(toX(at), frame.y + frame.height);
    context.stroke();
  };
  if (hoverTime !== null) upright(hoverTime, colours.past);
  upright(time, colours.cursor);
  context.font = "11px system-ui, sans-serif";
  const values = valuesAt(plot, time);
  const room = (width - 16) / Math.max(values.length, 1);
  values.forEach(({ line, value }, index) => {
    const place = 8 + index * Math.min(room, 165);
    context.strokeStyle = line.colour;
    context.lineWidth = 2.5;
    context.setLineDash(line.dash);
    context.beginPath();
    context.moveTo(place, 27);
    context.lineTo(place + 13, 27);
    context.stroke();
    const digits = room < 100 ? 3 : room < 140 ? 4 : DIGITS;
    const text = room < 75 ? line.name : `${line.name} ${format(value, digits)}`;
    context.fillText(text, place + 16, 31, Math.max(room - 24, 20));
  });
  context.setLineDash([]);
}
