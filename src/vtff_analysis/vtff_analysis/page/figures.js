// Figures of a page whose lines can be zoomed: the picture is replaced by canvases of its panels.
// A drag or the wheel zooms along x, values fit what is shown, a double click shows all, hovering
// tells the values. The picture stays for print, without script, and as a file to save.

import { stayLight } from "./colours.js";
import { drawAxes, drawTip, format, niceTicks, prepare } from "./canvas.js";

const MARGIN = { left: 66, right: 16, bottom: 36 };
const DRAG_LEAST = 6; // pixels: less is a click
const DIGITS = 7;
const NARROW = 560; // pixels: panels of a row stand below each other
const HEIGHT = 250; // pixels of a panel with one row of names, as in page.css
const LEGEND_ROW = 16; // pixels
const TITLE_FONT = "600 13px system-ui, sans-serif";
const LEAST_ROOM = 15; // pixels between ticks of a symmetric logarithmic axis
const ROOM = 0.05; // of the values, above and below

class Panel {
  constructor(content, group) {
    const { ticks, ...others } = content; // `ticks` is a method
    Object.assign(this, others);
    this.group = group; // panels with the same x axis zoom together
    this.lines = content.lines;
    this.named = ticks ?? [];
    this.hover = null;
    this.drag = null;
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", [content.title, content.y, content.x].filter(Boolean).join(", "));
    this.listen();
  }

  listen() {
    const { canvas, group } = this;
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      canvas.setPointerCapture(event.pointerId);
      this.drag = { from: event.offsetX, to: event.offsetX };
    });
    canvas.addEventListener("pointermove", (event) => {
      this.hover = { x: event.offsetX, y: event.offsetY };
      if (this.drag) this.drag.to = event.offsetX;
      this.draw();
    });
    canvas.addEventListener("pointerup", () => {
      const { drag } = this;
      this.drag = null;
      if (drag && Math.abs(drag.to - drag.from) >= DRAG_LEAST) {
        group.show([this.valueAt(drag.from), this.valueAt(drag.to)].sort((a, b) => a - b));
      } else this.draw();
    });
    canvas.addEventListener("pointercancel", () => { this.drag = null; });
    canvas.addEventListener("pointerleave", () => {
      this.hover = null;
      this.draw();
    });
    canvas.addEventListener("dblclick", () => group.show(null));
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !group.window) return; // scrolls the page
      event.preventDefault();
      const [from, to] = this.rangeX().map((value) => this.scaled(value, 0));
      const about = this.scaled(this.valueAt(event.offsetX), 0);
      const factor = event.deltaY > 0 ? 1.25 : 0.8;
      group.show([from, to].map((value) => this.unscaled(about + (value - about) * factor, 0)));
    }, { passive: false });
  }

  scaled(value, axis) {
    if (axis === 1 && this.symlog) {
      const [limit, part] = this.symlog;
      const size = Math.abs(value) / limit;
      return Math.sign(value) * (size <= 1 ? part * size : part + Math.log10(size));
    }
    return this.log[axis] ? Math.log10(value) : value;
  }

  unscaled(value, axis) {
    if (axis === 1 && this.symlog) {
      const [limit, part] = this.symlog;
      const size = Math.abs(value);
      return Math.sign(value) * limit * (size <= part ? size / part : 10 ** (size - part));
    }
    return this.log[axis] ? 10 ** value : value;
  }

  rangeX() {
    const [low, high] = this.limits[0];
    const window = this.group.window;
    return window && low <= high ? [Math.max(window[0], low), Math.min(window[1], high)] : [low, high];
  }

  // The limits of the picture while everything is shown, else those of what is shown.
  rangeY([from, to]) {
    if (!this.group.window) return this.limits[1];
    let [low, high] = [Infinity, -Infinity];
    for (const line of this.lines) {
      if (!line.x) continue;
      line.x.forEach((x, index) => {
        const y = line.y[index];
        if (x < from || x > to || !Number.isFinite(y) || (this.log[1] && y <= 0)) return;
        low = Math.min(low, y);
        high = Math.max(high, y);
      });
    }
    if (!(low <= high) || (this.named.length && !this.symlog)) return this.limits[1];
    const [a, b] = [this.scaled(low, 1), this.scaled(high, 1)];
    const room = ROOM * (b - a) || Math.max(Math.abs(b) * ROOM, 1e-12);
    const range = [this.unscaled(a - room, 1), this.unscaled(b + room, 1)];
    return this.limits[1][0] <= this.limits[1][1] ? range : range.reverse(); // a turned axis stays so
  }

  valueAt(pixel) {
    const { frame, x } = this.drawn;
    const part = Math.min(Math.max((pixel - frame.x) / frame.width, 0), 1);
    return this.unscaled(x[0] + part * (x[1] - x[0]), 0);
  }

  draw() {
    if (!this.canvas.clientWidth) return;
    const named = this.lines.filter((line) => line.name);
    const measuring = this.canvas.getContext("2d", { willReadFrequently: true });
    const legendRows = legend(measuring, named, this.canvas.clientWidth);
    const titleRows = wrapped(measuring, this.title, this.canvas.clientWidth - 16);
    // Names of many lines and a long title take no room from the lines.
    const rows = Math.max(0, legendRows.length - 1) + Math.max(0, titleRows.length - 1);
    this.canvas.style.height = `${HEIGHT + LEGEND_ROW * rows}px`;
    const { context, width, height } = prepare(this.canvas);
    if (!height) return;
    const below = 4 + LEGEND_ROW * titleRows.length; // the title
    const top = below + LEGEND_ROW * legendRows.length + 4;
    const frame = { x: MARGIN.left, y: top, width: width - MARGIN.left - MARGIN.right, height: height - top - MARGIN.bottom };
    const shown = this.rangeX();
    const x = shown.map((value) => this.scaled(value, 0));
    const y = this.rangeY(shown).map((value) => this.scaled(value, 1));
    this.drawn = { frame, x, y };
    context.fillStyle = "#ffffff";
    context.fillRect(0, 0, width, height);
    const ticks = {
      x: this.ticks(x, frame.width < 300 ? 3 : 6, 0),
      y: this.namedTicks() ?? this.symmetricTicks(y, frame.height) ?? this.ticks(y, Math.max(2, Math.round(frame.height / 45)), 1),
    };
    const { toX, toY } = drawAxes(context, frame, { x, y }, ticks, { x: this.x, y: this.y });
    const place = { x: (value) => toX(this.scaled(value, 0)), y: (value) => toY(this.scaled(value, 1)) };
    context.save();
    context.beginPath();
    context.rect(frame.x, frame.y, frame.width, frame.height);
    context.clip();
    for (const line of this.lines) traceAny(context, line, place, frame);
    context.restore();
    context.fillStyle = "#1b1f24";
    context.textAlign = "left";
    context.font = TITLE_FONT;
    titleRows.forEach((row, number) => context.fillText(row, 8, 15 + LEGEND_ROW * number, width - 16));
    drawLegend(context, legendRows, below + 12);
    this.drawPointer(context, frame, place, width, height);
  }

  ticks([low, high], count, axis) {
    const chosen = niceTicks(Math.min(low, high), Math.max(low, high), count);
    if (!this.log[axis] && !(axis === 1 && this.symlog)) return chosen;
    return { ticks: chosen.ticks, text: (value) => format(this.unscaled(value, axis), 3) };
  }

  // Ticks of an axis whose places have names; null where it has numbers.
  namedTicks() {
    if (!this.named.length || this.symlog) return null;
    const names = new Map(this.named);
    return { ticks: [...names.keys()], text: (value) => names.get(value) };
  }

  // Zero, the ends of the linear part and whole powers beyond, as far as they have room.
  symmetricTicks([low, high], height) {
    if (!this.symlog) return null;
    const [limit, part] = this.symlog;
    const room = (LEAST_ROOM * Math.abs(high - low)) / height;
    const [least, most] = [Math.min(low, high), Math.max(low, high)];
    const sides = [0];
    for (let power = 0; part + power <= Math.max(-least, most); power += 1) {
      if (part + power - sides.at(-1) >= room) sides.push(part + power);
    }
    const ticks = [...sides.slice(1).map((tick) => -tick), ...sides].filter((tick) => tick >= least && tick <= most);
    if (ticks.length < 2) return this.ticks([low, high], Math.max(2, Math.round(height / 45)), 1);
    return { ticks, text: (value) => format(this.unscaled(value, 1), 3).replace("-", "−") };
  }

  drawPointer(context, frame, place, width, height) {
    const { hover, drag } = this;
    if (drag && Math.abs(drag.to - drag.from) >= DRAG_LEAST) {
      context.fillStyle = "rgba(0, 114, 178, .2)";
      context.fillRect(Math.min(drag.from, drag.to), frame.y, Math.abs(drag.to - drag.from), frame.height);
      return;
    }
    if (!hover || hover.x < frame.x || hover.x > frame.x + frame.width || hover.y < frame.y) return;
    const at = this.valueAt(hover.x);
    const told = this.lines.filter((line) => line.x?.length && !line.area).map((line) => {
      const index = nearest(line.x, at);
      return { line, index, off: Math.abs(place.x(line.x[index]) - hover.x) };
    }).filter(({ off }) => off < 12).sort((a, b) => a.off - b.off).slice(0, 6);
    if (!told.length) return;
    const [{ line, index }] = told;
    const values = told.map((one) => `${one.line.name || this.y} ${format(one.line.y[one.index], DIGITS)}`);
    drawTip(context, place.x(line.x[index]), hover.y, [`${this.x} ${format(line.x[index], DIGITS)}`, ...values], width, height);
  }
}

class Group {
  constructor() {
    this.window = null;
    this.panels = [];
  }

  show(window) {
    this.window = window && window[1] > window[0] ? window : null;
    for (const panel of this.panels) panel.draw();
  }
}

function unpack({ middle, float32 }) {
  const bytes = Uint8Array.from(atob(float32), (character) => character.charCodeAt(0));
  return Float64Array.from(new Float32Array(bytes.buffer), (value) => value + middle);
}

// Index of the value next to a number; the values need no order.
function nearest(values, number) {
  let best = 0;
  for (let index = 1; index < values.length; index += 1) {
    if (Math.abs(values[index] - number) < Math.abs(values[best] - number)) best = index;
  }
  return best;
}

function traceAny(context, line, place, frame) {
  context.strokeStyle = line.colour;
  context.fillStyle = line.colour;
  context.lineWidth = 1.6;
  context.setLineDash(line.dash);
  context.beginPath();
  if (line.area) {
    let open = false;
    line.x.forEach((value, index) => {
      const [x, y] = [place.x(value), place.y(line.y[index])];
      if (!Number.isFinite(x) || !Number.isFinite(y)) open = false;
      else if (open) context.lineTo(x, y);
      else [context.moveTo(x, y), open = true];
    });
    context.fill();
    return;
  }
  if (line.across !== undefined || line.upright !== undefined) {
    const [x, y] = [line.upright !== undefined && place.x(line.upright), line.across !== undefined && place.y(line.across)];
    if (x !== false) [context.moveTo(x, frame.y), context.lineTo(x, frame.y + frame.height)];
    else [context.moveTo(frame.x, y), context.lineTo(frame.x + frame.width, y)];
  } else if (line.points) {
    line.x.forEach((x, index) => context.fillRect(place.x(x) - 1.5, place.y(line.y[index]) - 1.5, 3, 3));
  } else {
    let drawing = false;
    line.x.forEach((value, index) => {
      const [x, y] = [place.x(value), place.y(line.y[index])];
      if (!Number.isFinite(x) || !Number.isFinite(y)) drawing = false;
      else if (!drawing) {
        context.moveTo(x, y);
        drawing = true;
      } else {
        if (line.steps) context.lineTo(x, place.y(line.y[index - 1]));
        context.lineTo(x, y);
      }
    });
  }
  context.stroke();
  context.setLineDash([]);
}

// Rows of words of a title that fit a width.
function wrapped(context, text, width) {
  context.font = TITLE_FONT;
  const rows = [];
  for (const word of text ? text.split(" ") : []) {
    const longer = rows.length ? `${rows.at(-1)} ${word}` : word;
    if (rows.length && context.measureText(longer).width <= width) rows[rows.length - 1] = longer;
    else rows.push(word);
  }
  return rows;
}

// Names of lines in rows that fit a width.
function legend(context, lines, width) {
  context.font = "12px system-ui, sans-serif";
  const rows = [];
  let left = Infinity;
  for (const line of lines) {
    const wide = context.measureText(line.name).width + 38;
    if (left + wide > width - 8) {
      rows.push([]);
      left = 8;
    }
    rows.at(-1).push({ line, left });
    left += wide;
  }
  return rows;
}

function drawLegend(context, rows, top) {
  context.font = "12px system-ui, sans-serif";
  rows.forEach((row, number) => {
    for (const { line, left } of row) {
      const y = top + LEGEND_ROW * number - 4;
      context.strokeStyle = line.colour;
      context.fillStyle = line.colour;
      context.lineWidth = 2.5;
      context.setLineDash(line.dash);
      if (line.area) context.fillRect(left, y - 5, 20, 10);
      else if (line.points) context.fillRect(left + 8, y - 3, 6, 6);
      else {
        context.beginPath();
        context.moveTo(left, y);
        context.lineTo(left + 20, y);
        context.stroke();
      }
      context.setLineDash([]);
      context.fillStyle = "#1b1f24";
      context.textAlign = "left";
      context.fillText(line.name, left + 25, y + 4);
    }
  });
}

function bring(figure) {
  const { rows, arrays } = JSON.parse(figure.dataset.lines);
  const numbers = arrays.map(unpack);
  for (const line of rows.flat().flatMap((panel) => panel.lines)) {
    if (line.x === undefined) continue; // a line through the whole panel
    line.x = numbers[line.x];
    line.y = numbers[line.y];
  }
  const image = figure.querySelector("img");
  const groups = new Map();
  const area = document.createElement("div");
  area.className = "panels";
  const panels = rows.flatMap((row) => {
    const line = document.createElement("div");
    line.className = "row";
    area.append(line);
    return row.map((content) => {
      // Panels of one figure with the same limits are parts of one picture of time.
      const key = content.limits[0].join();
      if (!groups.has(key)) groups.set(key, new Group());
      const panel = new Panel(content, groups.get(key));
      groups.get(key).panels.push(panel);
      line.append(panel.canvas);
      return panel;
    });
  });
  const save = document.createElement("a");
  save.href = image.src;
  save.download = `${figure.dataset.name}.png`;
  save.textContent = "PNG";
  const hint = document.createElement("p");
  hint.className = "small hint";
  hint.append("drag: zoom · double click: all · ", save);
  image.classList.add("printed");
  image.after(area, hint);
  const draw = () => {
    area.classList.toggle("narrow", area.clientWidth < NARROW);
    for (const panel of panels) panel.draw();
  };
  new ResizeObserver(draw).observe(area);
  figure.panels = panels; // for tests, and for the curious
}

stayLight();
for (const figure of document.querySelectorAll("figure[data-lines]")) bring(figure);
