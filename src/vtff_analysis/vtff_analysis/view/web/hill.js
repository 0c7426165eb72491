// The formation in the chief's RTN (Hill) frame: from the side and from above, both to one scale.
// It shows what the plots show of time. The wheel zooms, a drag moves, a double click fits again.

import { BESIDE, CHIEF, craftColour, page } from "./colours.js";
import { drawAxes, drawTip, format, niceTicks, placeLabels, prepare } from "./canvas.js";
import { indexAt } from "./scene.js";

const VIEWS = [
  { across: "in_track", up: "radial", names: ["in-track (m)", "radial (m)"] },
  { across: "in_track", up: "cross_track", names: ["in-track (m)", "cross-track (m)"] },
];
const NEAR = 14; // pixels from which a sample is told
const NARROW = 520; // pixels of a pane in which the views stand below each other

export class HillPanel {
  constructor(canvas, scene, shownTimes) {
    this.canvas = canvas;
    this.scene = scene;
    this.shownTimes = shownTimes; // function: [from, to] in s, or null for all
    this.fitted = null; // { scale, centre: { axis: m } } chosen by hand; null: all that is shown
    this.hover = null;
    this.frames = [];
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "Deputies relative to the chief, in-track, radial and cross-track");
    this.listen();
    this.update();
  }

  listen() {
    const { canvas } = this;
    let drag = null;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      drag = { x: event.offsetX, y: event.offsetY, view: this.placeAt(event.offsetX, event.offsetY)?.view };
    });
    canvas.addEventListener("pointermove", (event) => {
      this.hover = { x: event.offsetX, y: event.offsetY };
      if (!drag || !drag.view) return;
      const fit = this.fit();
      fit.centre[drag.view.across] -= (event.offsetX - drag.x) * fit.scale;
      fit.centre[drag.view.up] += (event.offsetY - drag.y) * fit.scale;
      this.fitted = fit;
      Object.assign(drag, { x: event.offsetX, y: event.offsetY });
    });
    const end = () => { drag = null; };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("pointerleave", () => { this.hover = null; });
    canvas.addEventListener("dblclick", () => { this.fitted = null; });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(event.deltaY > 0 ? 1.2 : 1 / 1.2, event.offsetX, event.offsetY);
    }, { passive: false });
  }

  // Zoom about a point of the canvas, by default about the chief.
  zoom(factor, x = null, y = null) {
    const fit = this.fit();
    const place = this.placeAt(x, y);
    const keep = (axis, value) => {
      fit.centre[axis] = value + (fit.centre[axis] - value) * factor;
    };
    if (x !== null && place) {
      keep(place.view.across, place.fromX(x));
      keep(place.view.up, place.fromY(y));
    } else {
      for (const axis of Object.keys(fit.centre)) keep(axis, 0);
    }
    fit.scale *= factor;
    this.fitted = fit;
  }

  // The view under a point of the canvas; undefined beside them.
  placeAt(x, y) {
    return this.frames.find(({ frame }) => x >= frame.x && x <= frame.x + frame.width
      && y >= frame.y && y <= frame.y + frame.height);
  }

  update() {
    const { scene } = this;
    const deputies = [...new Set(scene.ofKind("relative").map((series) => series.deputy))];
    const crafts = scene.spacecraft();
    this.chief = crafts.find((craft) => !deputies.includes(craft)) ?? "chief";
    this.tracks = deputies.map((deputy, index) => ({
      deputy,
      colour: craftColour(crafts.includes(deputy) ? crafts.indexOf(deputy) : index + 1),
      series: scene.get("relative", deputy, "truth") ?? scene.get("relative", deputy, "estimate"),
      target: scene.get("relative", deputy, "target"),
      beside: scene.beside?.get("relative", deputy, "truth") ?? scene.beside?.get("relative", deputy, "estimate"),
    })).filter((track) => track.series);
  }

  // Scale in m a pixel and centre in m of both views: those chosen by hand, or that of all shown.
  fit() {
    if (this.fitted) return { scale: this.fitted.scale, centre: { ...this.fitted.centre } };
    const [from, to] = this.shownTimes() ?? [-Infinity, Infinity];
    const limits = {};
    for (const axis of ["radial", "in_track", "cross_track"]) {
      limits[axis] = [0, 0]; // the chief is always in view
      for (const { series } of this.tracks) {
        const last = indexAt(series.time, to);
        for (let index = Math.max(indexAt(series.time, from), 0); index <= last; index += 1) {
          const value = series.columns[axis][index];
          limits[axis] = [Math.min(limits[axis][0], value), Math.max(limits[axis][1], value)];
        }
      }
    }
    const size = (axis) => limits[axis][1] - limits[axis][0];
    const { width, height } = this.frameSize();
    const scale = 1.25 * Math.max(size("in_track") / width, size("radial") / height,
      size("cross_track") / height, 1e-7);
    const centre = {};
    for (const axis of Object.keys(limits)) centre[axis] = (limits[axis][0] + limits[axis][1]) / 2;
    return { scale, centre };
  }

  frameSize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const [columns, rows] = this.isNarrow() ? [1, 2] : [2, 1];
    return { width: Math.max(width / columns - 80, 40), height: Math.max(height / rows - 48, 40) };
  }

  isNarrow() {
    return this.canvas.clientWidth < NARROW;
  }

  draw(time) {
    const { context, width, height } = prepare(this.canvas);
    context.clearRect(0, 0, width, height);
    if (!this.tracks.length) {
      context.fillStyle = page().faint;
      context.font = "13px system-ui, sans-serif";
      context.textAlign = "left";
      context.fillText("no relative states in this run", 12, 24);
      return;
    }
    const fit = this.fit();
    const size = this.frameSize();
    this.frames = VIEWS.map((view, index) => {
      const [column, row] = this.isNarrow() ? [0, index] : [index, 0];
      const frame = { x: 66 + (column * width) / 2, y: 10 + (row * height) / 2, ...size };
      return this.drawView(context, view, frame, time, fit);
    });
    this.drawNearest(context, width, height);
  }

  drawView(context, view, frame, time, { scale, centre }) {
    const middle = (axis, length) => [centre[axis] - (scale * length) / 2, centre[axis] + (scale * length) / 2];
    const range = { x: middle(view.across, frame.width), y: middle(view.up, frame.height) };
    const ticks = { x: niceTicks(...range.x, Math.min(5, Math.max(1, Math.floor(frame.width / 75)))), y: niceTicks(...range.y, 6) };
    const labels = { x: view.names[0], y: view.names[1] };
    const { toX, toY } = drawAxes(context, frame, range, ticks, labels);
    context.save();
    context.beginPath();
    context.rect(frame.x, frame.y, frame.width, frame.height);
    context.clip();
    this.drawHardRadius(context, toX, toY, scale);
    const names = this.tracks.map((track) => this.drawTrack(context, track, view, toX, toY, time)).filter(Boolean);
    marker(context, toX(0), toY(0), CHIEF, "square");
    writeNames(context, [{ x: toX(0), y: toY(0) + 24, name: this.chief }, ...names], frame);
    context.restore();
    return {
      view, frame, toX, toY,
      fromX: (x) => range.x[0] + ((x - frame.x) / frame.width) * (range.x[1] - range.x[0]),
      fromY: (y) => range.y[1] - ((y - frame.y) / frame.height) * (range.y[1] - range.y[0]),
    };
  }

  drawHardRadius(context, toX, toY, scale) {
    const radius = this.scene.hardRadius / scale;
    if (!(radius > 2)) return;
    context.strokeStyle = page().axes[1];
    context.setLineDash([4, 3]);
    context.lineWidth = 1;
    context.beginPath();
    context.arc(toX(0), toY(0), radius, 0, 2 * Math.PI);
    context.stroke();
    context.setLineDash([]);
  }

  // Draw a deputy; return where its name belongs, or null before its first sample.
  drawTrack(context, track, view, toX, toY, time) {
    const { series, colour } = track;
    const last = series.indexAt(time);
    const trace = (from, to, style, width, traced) => {
      const [across, up] = [traced.columns[view.across], traced.columns[view.up]];
      context.strokeStyle = style;
      context.lineWidth = width;
      context.beginPath();
      for (let index = from; index <= to; index += 1) context.lineTo(toX(across[index]), toY(up[index]));
      context.stroke();
    };
    if (track.beside) {
      context.setLineDash([3, 3]);
      trace(0, track.beside.time.length - 1, BESIDE, 1.5, track.beside);
      context.setLineDash([]);
    }
    const [from, to] = this.shownTimes() ?? [-Infinity, Infinity];
    const first = Math.max(series.indexAt(from), 0);
    trace(first, series.indexAt(to), page().past, 1, series);
    trace(first, last, colour, 2, series);
    const target = track.target?.sampleAt(time);
    if (target) cross(context, toX(target[view.across]), toY(target[view.up]));
    if (last < 0) return null;
    const sample = series.sampleAt(time);
    const [x, y] = [toX(sample[view.across]), toY(sample[view.up])];
    marker(context, x, y, colour, "circle");
    return { x, y, name: track.deputy };
  }

  // Time and coordinates of the sample next to the pointer.
  drawNearest(context, width, height) {
    const { hover } = this;
    const place = hover && this.placeAt(hover.x, hover.y);
    if (!place) return;
    let nearest = null;
    for (const { deputy, series } of this.tracks) {
      const [across, up] = [series.columns[place.view.across], series.columns[place.view.up]];
      for (let index = 0; index < series.time.length; index += 1) {
        const distance = Math.hypot(place.toX(across[index]) - hover.x, place.toY(up[index]) - hover.y);
        if (distance < (nearest?.distance ?? NEAR)) nearest = { distance, deputy, series, index };
      }
    }
    if (!nearest) return;
    const { deputy, series, index } = nearest;
    const text = (axis) => `${axis.replace("_", "-")} ${format(series.columns[axis][index], 7)} m`;
    drawTip(context, hover.x, hover.y, [`${deputy}, ${format(series.time[index], 6)} s`,
      ...["radial", "in_track", "cross_track"].map(text)], width, height);
  }
}

function marker(context, x, y, colour, shape) {
  context.fillStyle = colour;
  context.strokeStyle = page().ink;
  context.lineWidth = 1;
  context.beginPath();
  if (shape === "square") context.rect(x - 5, y - 5, 10, 10);
  else context.arc(x, y, 5.5, 0, 2 * Math.PI);
  context.fill();
  context.stroke();
}

// Write names beside their markers, none over another or cut off by the frame.
function writeNames(context, names, frame) {
  context.fillStyle = page().ink;
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "left";
  const wished = names.map(({ x, y, name }) => ({
    left: x + 9 - frame.x, top: y - 19 - frame.y, wide: context.measureText(name).width, high: 14,
  }));
  placeLabels(wished, frame.width, frame.height).forEach(({ left, top }, index) => {
    context.fillText(names[index].name, frame.x + left, frame.y + top + 11);
  });
}

function cross(context, x, y) {
  context.strokeStyle = page().ink;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x - 6, y - 6);
  context.lineTo(x + 6, y + 6);
  context.moveTo(x - 6, y + 6);
  context.lineTo(x + 6, y - 6);
  context.stroke();
}
