// Drawing on canvases: sharp on any screen, ticks at round numbers, lines with gaps.

import { page } from "./colours.js";

// Fit a canvas to its place; tells whether it was cleared by that.
export function prepare(canvas) {
  const scale = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const changed = canvas.width !== Math.round(width * scale)
    || canvas.height !== Math.round(height * scale);
  if (changed) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.setTransform(scale, 0, 0, scale, 0, 0);
  return { context, width, height, changed };
}

// Round numbers within a range, about `count` of them.
export function niceTicks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((value) => value >= 0.7 * rough);
  const ticks = [];
  for (let index = Math.ceil(low / step); index * step <= high + 1e-9 * step; index += 1) {
    ticks.push(index * step);
  }
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const largest = Math.max(Math.abs(low), Math.abs(high));
  if (decimals > 4 || (largest >= 1e6 && step >= 1e3)) { // as decimals they would cover the name of the axis
    const digits = Math.max(0, Math.ceil(Math.log10(Math.max(...ticks.map(Math.abs), step) / step) - 1e-9));
    return { ticks, text: (value) => (Math.abs(value) < step / 2 ? "0" : value.toExponential(Math.min(digits, 3)).replace("e+", "e")) };
  }
  return { ticks, text: (value) => value.toFixed(decimals) };
}

// Frame, grid and tick labels, and names of the axes where `labels` has them.
export function drawAxes(context, frame, range, ticks, labels = {}) {
  context.font = "11px system-ui, sans-serif";
  context.lineWidth = 1;
  context.setLineDash([]);
  const colours = page();
  context.strokeStyle = colours.grid;
  context.fillStyle = colours.faint;
  context.textAlign = "center";
  const toX = (value) => frame.x + ((value - range.x[0]) / (range.x[1] - range.x[0])) * frame.width;
  const toY = (value) => frame.y + frame.height
    - ((value - range.y[0]) / (range.y[1] - range.y[0])) * frame.height;
  for (const tick of ticks.x.ticks) {
    line(context, toX(tick), frame.y, toX(tick), frame.y + frame.height);
    // The number of a tick at the edge is moved, not cut.
    const text = ticks.x.text(tick);
    const half = context.measureText(text).width / 2 + 1;
    const middle = Math.min(Math.max(toX(tick), half), context.canvas.clientWidth - half);
    context.fillText(text, middle, frame.y + frame.height + 14);
  }
  context.textAlign = "right";
  for (const tick of ticks.y.ticks) {
    line(context, frame.x, toY(tick), frame.x + frame.width, toY(tick));
    context.fillText(ticks.y.text(tick), frame.x - 5, toY(tick) + 4);
  }
  context.strokeStyle = colours.frame;
  context.strokeRect(frame.x, frame.y, frame.width, frame.height);
  if (labels.x) {
    context.textAlign = "center";
    context.fillText(labels.x, frame.x + frame.width / 2, frame.y + frame.height + 28);
  }
  if (labels.y) {
    context.save();
    context.translate(frame.x - 46, frame.y + frame.height / 2);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.fillText(labels.y, 0, 0, frame.height);
    context.restore();
  }
  return { toX, toY };
}

// A number with as many digits as are told, without a trail of zeros; small and large ones as powers.
export function format(value, digits) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size === 0) return "0";
  if (size >= 1e6 || size < 1e-4) return value.toExponential(Math.min(digits - 1, 3));
  if (size >= 10 ** digits) return value.toFixed(0);
  const text = value.toPrecision(digits);
  return text.includes(".") && !text.includes("e") ? text.replace(/\.?0+$/, "") : text;
}

// A length in the unit in which it is easily read.
export function lengthText(metres, digits = 4) {
  const size = Math.abs(metres);
  if (size >= 1e4) return `${format(metres / 1e3, digits)} km`;
  if (size > 0 && size < 1) return `${format(metres * 1e3, digits)} mm`;
  return `${format(metres, digits)} m`;
}

// Places of labels within a canvas, each moved down until it covers no other; upper left corners.
// Each has wished `left` and `top`, and its size `wide` and `high`.
export function placeLabels(labels, width, height) {
  const taken = [];
  for (const { left: x, top: y, wide, high } of labels) {
    const left = Math.min(Math.max(x, 4), Math.max(width - wide - 4, 4));
    let top = Math.min(Math.max(y, 4), height - high - 4);
    const covered = () => taken.find((other) => left < other.left + other.wide && other.left < left + wide
      && top < other.top + other.high && other.top < top + high);
    for (let other = covered(); other && top < height; other = covered()) top = other.top + other.high;
    taken.push({ left, top, wide, high });
  }
  return taken;
}

// Small box of lines beside a point, within the canvas.
export function drawTip(context, x, y, lines, width, height) {
  const colours = page();
  context.font = "11px system-ui, sans-serif";
  const wide = Math.max(...lines.map((line) => context.measureText(line).width)) + 12;
  const high = 15 * lines.length + 6;
  const left = x + 12 + wide < width ? x + 12 : Math.max(0, x - 12 - wide);
  const top = Math.min(Math.max(0, y - high / 2), height - high);
  context.setLineDash([]);
  context.fillStyle = colours.paper;
  context.strokeStyle = colours.frame;
  context.lineWidth = 1;
  context.fillRect(left, top, wide, high);
  context.strokeRect(left, top, wide, high);
  context.fillStyle = colours.ink;
  context.textAlign = "left";
  lines.forEach((line, index) => context.fillText(line, left + 6, top + 15 + 15 * index));
}

// A line over time with gaps where values are missing; as steps where a value holds.
export function traceLine(context, { series, column, colour, dash }, toX, toY, steps = false) {
  const values = series.columns[column];
  const times = series.time;
  const usual = times.length > 1 ? (times.at(-1) - times[0]) / (times.length - 1) : 1;
  context.strokeStyle = colour;
  context.lineWidth = 1.6;
  context.setLineDash(dash);
  context.beginPath();
  let drawing = false;
  for (let index = 0; index < times.length; index += 1) {
    if (values[index] === null) {
      drawing = false;
      continue;
    }
    if (drawing && times[index] - times[index - 1] > 5 * usual) drawing = false;
    const [x, y] = [toX(times[index]), toY(values[index])];
    if (!drawing) context.moveTo(x, y);
    else if (steps) {
      context.lineTo(x, toY(values[index - 1]));
      context.lineTo(x, y);
    } else context.lineTo(x, y);
    if (!drawing) context.lineTo(x + 0.5, y); // a single sample shows too
    drawing = true;
  }
  context.stroke();
  context.setLineDash([]);
}

function line(context, x0, y0, x1, y1) {
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  context.stroke();
}
