// The formation in the chief's RTN (Hill) frame, at its own scale: from the side and from above.

import { CHIEF, craftColour } from "./colours.js";
import { drawAxes, niceTicks, prepare } from "./canvas.js";

const VIEWS = [
  { across: "in_track", up: "radial", names: ["in-track (m)", "radial (m)"] },
  { across: "in_track", up: "cross_track", names: ["in-track (m)", "cross-track (m)"] },
];

export class HillPanel {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "Deputies relative to the chief, in-track, radial and cross-track");
    this.update();
  }

  update() {
    const { scene } = this;
    const deputies = [...new Set(scene.ofKind("relative").map((series) => series.deputy))];
    const crafts = scene.spacecraft();
    this.tracks = deputies.map((deputy, index) => ({
      deputy,
      colour: craftColour(crafts.includes(deputy) ? crafts.indexOf(deputy) : index + 1),
      series: scene.get("relative", deputy, "truth") ?? scene.get("relative", deputy, "estimate"),
      estimate: scene.get("relative", deputy, "estimate"),
      target: scene.get("relative", deputy, "target"),
    })).filter((track) => track.series);
    this.largest = {};
    for (const axis of ["radial", "in_track", "cross_track"]) {
      let [low, high] = [0, 0]; // the chief is always in view
      for (const { series } of this.tracks) {
        for (const value of series.columns[axis]) {
          low = Math.min(low, value);
          high = Math.max(high, value);
        }
      }
      this.largest[axis] = [low, high];
    }
  }

  draw(time) {
    const { context, width, height } = prepare(this.canvas);
    context.clearRect(0, 0, width, height);
    if (!this.tracks.length) {
      context.fillStyle = "#5b6470";
      context.font = "13px system-ui, sans-serif";
      context.fillText("no relative states", 12, 24);
      return;
    }
    VIEWS.forEach((view, index) => {
      const frame = { x: 62 + (index * width) / 2, y: 10, width: width / 2 - 76, height: height - 48 };
      this.drawView(context, view, frame, time);
    });
  }

  drawView(context, view, frame, time) {
    // One scale on both axes: circles stay circles.
    const [left, right] = this.largest[view.across];
    const [bottom, top] = this.largest[view.up];
    const scale = Math.max((right - left) / frame.width, (top - bottom) / frame.height, 1e-3) * 1.25;
    const [middle, centre] = [(left + right) / 2, (bottom + top) / 2];
    const range = {
      x: [middle - (scale * frame.width) / 2, middle + (scale * frame.width) / 2],
      y: [centre - (scale * frame.height) / 2, centre + (scale * frame.height) / 2],
    };
    const ticks = { x: niceTicks(...range.x, 5), y: niceTicks(...range.y, 6) };
    const labels = { x: view.names[0], y: view.names[1] };
    const { toX, toY } = drawAxes(context, frame, range, ticks, labels);
    context.save();
    context.beginPath();
    context.rect(frame.x, frame.y, frame.width, frame.height);
    context.clip();
    for (const track of this.tracks) {
      this.drawTrack(context, track, view, toX, toY, time, frame);
    }
    marker(context, toX(0), toY(0), CHIEF, "chief", "square", frame);
    context.restore();
  }

  drawTrack(context, track, view, toX, toY, time, frame) {
    const { series, colour } = track;
    const last = series.indexAt(time);
    const [across, up] = [series.columns[view.across], series.columns[view.up]];
    const trace = (from, to, style, width) => {
      context.strokeStyle = style;
      context.lineWidth = width;
      context.beginPath();
      for (let index = from; index <= to; index += 1) context.lineTo(toX(across[index]), toY(up[index]));
      context.stroke();
    };
    trace(0, series.time.length - 1, "#c5ccd3", 1);
    trace(0, last, colour, 2);
    const target = track.target?.sampleAt(time);
    if (target) cross(context, toX(target[view.across]), toY(target[view.up]));
    if (last >= 0) {
      marker(context, toX(across[last]), toY(up[last]), colour, track.deputy, "circle", frame);
    }
  }
}

function marker(context, x, y, colour, name, shape, frame) {
  context.fillStyle = colour;
  context.strokeStyle = "#1b1f24";
  context.lineWidth = 1;
  context.beginPath();
  if (shape === "square") context.rect(x - 5, y - 5, 10, 10);
  else context.arc(x, y, 5.5, 0, 2 * Math.PI);
  context.fill();
  context.stroke();
  context.fillStyle = "#1b1f24";
  context.font = "12px system-ui, sans-serif";
  const left = x < frame.x + 0.8 * frame.width; // else its name would be cut off
  context.textAlign = left ? "left" : "right";
  context.fillText(name, left ? x + 9 : x - 9, shape === "square" ? y + 17 : y - 8);
}

function cross(context, x, y) {
  context.strokeStyle = "#1b1f24";
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x - 6, y - 6);
  context.lineTo(x + 6, y + 6);
  context.moveTo(x - 6, y + 6);
  context.lineTo(x + 6, y - 6);
  context.stroke();
}
