// The formation close up on a plain canvas, in the chief's RTN frame and without perspective: what an
// exported page shows, which has no globe. A drag turns, the wheel zooms, a double click fits again.

import { lengthText, placeLabels } from "./canvas.js";
import { craftColour } from "./colours.js";
import {
  ALONE_SHARE, ARROW_SIZES, ATTITUDE_ARROWS, AXIS_COLOURS, BODY_BOX, CRAFT_SHARE, ELLIPSOID_SHARE, KEEP_OUT_COLOUR,
  LARGEST_RANGE, PANEL_BOXES, PANEL_COLOUR, SIGMAS, THRUST_SHARE, attitudeDirections, axisLength, covarianceAt,
  deputyText, largestDistance, largestThrust, magnification, placeAt, thrustAt, trailOf,
} from "./craft.js";

const SKY = "#0b1016";
const FIRST_TURN = { yaw: 0.65, pitch: 0.35 }; // rad: R up, T to the right, seen from -N and above
const STEEPEST = 1.5; // rad
const TURN = 0.008; // rad a pixel
const FITTING = 2.6; // of the largest distance: width that is seen
const LIGHT = [0.64, -0.3, -0.7]; // direction to the light, RTN
const FONT = "600 13px system-ui, sans-serif";

export class CloseView {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.shown = false;
    this.zoomed = 1;
    this.turn = { ...FIRST_TURN };
    this.listen();
    this.update();
  }

  listen() {
    const { canvas } = this;
    let drag = null;
    canvas.addEventListener("pointerdown", (event) => {
      if (!this.shown) return;
      canvas.setPointerCapture(event.pointerId);
      drag = { x: event.offsetX, y: event.offsetY };
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!drag) return;
      this.turn.yaw -= TURN * (event.offsetX - drag.x);
      const pitch = this.turn.pitch + TURN * (event.offsetY - drag.y);
      this.turn.pitch = Math.min(Math.max(pitch, -STEEPEST), STEEPEST);
      drag = { x: event.offsetX, y: event.offsetY };
    });
    const end = () => { drag = null; };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("dblclick", () => {
      this.zoomed = 1;
      this.turn = { ...FIRST_TURN };
    });
    canvas.addEventListener("wheel", (event) => {
      if (!this.shown) return;
      event.preventDefault();
      this.zoomed = Math.min(Math.max(this.zoomed * (event.deltaY > 0 ? 1.2 : 1 / 1.2), 1e-4), 1e3);
    }, { passive: false });
  }

  update() {
    this.largestThrust = largestThrust(this.scene);
    this.trails = new Map(this.scene.deputies().map(({ deputy, series }) => [deputy, trailOf(series)]));
  }

  // Draw at a time into a canvas that is prepared.
  draw(context, width, height, time) {
    this.range = Math.min(FITTING * largestDistance(this.scene, time), LARGEST_RANGE) * this.zoomed;
    this.view = makeView(this.turn, width, height, this.range);
    this.labels = [];
    context.fillStyle = SKY;
    context.fillRect(0, 0, width, height);
    const crafts = this.scene.spacecraft();
    const deputies = this.scene.deputies();
    const [chief] = crafts;
    this.drawKeepOut(context);
    this.drawAxes(context);
    const size = (deputies.length ? CRAFT_SHARE : ALONE_SHARE) * this.range;
    const solids = [{ name: chief, at: [0, 0, 0], size, colour: craftColour(0) }];
    if (deputies.length) this.labels.push({ at: [0, 0, 0], text: chief, colour: craftColour(0), below: true });
    for (const { deputy, series } of deputies) {
      const at = placeAt(series, time);
      if (!at) continue;
      const colour = craftColour(crafts.includes(deputy) ? crafts.indexOf(deputy) : 1);
      this.drawDeputy(context, deputy, at, time, colour);
      solids.push({ name: deputy, at, size, colour });
    }
    solids.sort((a, b) => this.view.depth(a.at) - this.view.depth(b.at));
    for (const solid of solids) this.drawCraft(context, solid, time);
    this.drawLabels(context, width, height);
  }

  drawKeepOut(context) {
    const radius = this.scene.hardRadius * this.view.scale;
    if (!(radius > 2) || this.scene.hardRadius > this.range) return;
    const [x, y] = this.view.project([0, 0, 0]);
    context.strokeStyle = KEEP_OUT_COLOUR;
    context.lineWidth = 1;
    context.setLineDash([4, 3]);
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.stroke();
    context.setLineDash([]);
  }

  drawAxes(context) {
    const length = axisLength(this.range);
    ["R", "T", "N"].forEach((name, axis) => {
      const end = [0, 0, 0];
      end[axis] = length;
      this.drawArrow(context, [0, 0, 0], end, AXIS_COLOURS[axis], 2.5);
      this.labels.push({ at: end, text: axis ? name : `${name} ${lengthText(length)}`, colour: AXIS_COLOURS[axis] });
    });
  }

  drawDeputy(context, deputy, at, time, colour) {
    this.drawLine(context, this.trails.get(deputy) ?? [], colour, 1.6);
    this.drawLine(context, [[0, 0, 0], at], "rgba(255, 255, 255, .55)", 1.2);
    const middle = at.map((value) => value / 2);
    this.labels.push({ at: middle, text: lengthText(Math.hypot(...at), 6), colour: "#ffffff" });
    const force = thrustAt(this.scene, deputy, time);
    if (Math.hypot(...force) > 1e-3 * this.largestThrust) {
      const scale = (THRUST_SHARE * this.range) / this.largestThrust;
      this.drawArrow(context, at, at.map((value, axis) => value + scale * force[axis]), "#ffffff", 3);
    }
    const covariance = covarianceAt(this.scene, deputy, time);
    const text = covariance ? this.drawEllipsoid(context, deputy, at, covariance, colour) : deputy;
    this.labels.push({ at, text, colour });
  }

  // Draw the outline of an ellipsoid, which is an ellipse without perspective; return its label.
  drawEllipsoid(context, deputy, at, covariance, colour) {
    const { right, up, scale } = this.view;
    const turned = (axis) => covariance.map((row) => dot(row, axis));
    const [xx, xy, yy] = [dot(right, turned(right)), dot(right, turned(up)), dot(up, turned(up))];
    const [middle, spread] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
    const largest = SIGMAS * Math.sqrt(largestVariance(covariance));
    const factor = magnification(ELLIPSOID_SHARE * this.range, largest);
    const pixels = (variance) => Math.max(factor * SIGMAS * scale * Math.sqrt(Math.max(variance, 0)), 1);
    const [x, y] = this.view.project(at);
    context.strokeStyle = colour;
    context.lineWidth = 1.2;
    context.beginPath();
    // The screen counts downwards, so that the angle changes its sign.
    context.ellipse(x, y, pixels(middle + spread), pixels(middle - spread), -0.5 * Math.atan2(2 * xy, xx - yy), 0, 2 * Math.PI);
    context.stroke();
    return deputyText(deputy, largest, factor);
  }

  // Draw a spacecraft and its attitude arrows, those that point away behind it.
  drawCraft(context, { name, at, size, colour }, time) {
    const attitude = this.scene.attitudeAt(name, time);
    const columns = attitude ? columnsOf(attitude.quaternion) : null;
    const directions = columns ? attitudeDirections(columns, attitude.field) : {};
    const arrows = ATTITUDE_ARROWS.filter((arrow) => directions[arrow.name]);
    const behind = (arrow) => dot(directions[arrow.name], this.view.toViewer) < 0;
    const draw = ({ name: text, colour: shade }) => {
      const end = at.map((value, axis) => value + ARROW_SIZES * size * directions[text][axis]);
      this.drawArrow(context, at, end, shade, 2.5);
      this.labels.push({ at: end, text, colour: shade });
    };
    arrows.filter(behind).forEach(draw);
    // The model is drawn along R, T and N; these are -z, x and -y of a body that points at the Earth.
    const axes = columns
      ? [columns[2].map((value) => -value), columns[0], columns[1].map((value) => -value)]
      : [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    const boxes = [[...BODY_BOX, colour], ...PANEL_BOXES.map((box) => [...box, PANEL_COLOUR])];
    const faces = boxes.flatMap(([dimensions, centre, shade]) => facesOf(dimensions, centre, axes, at, size, shade));
    const seen = faces.filter((face) => dot(face.normal, this.view.toViewer) > 0);
    seen.sort((a, b) => this.view.depth(a.centre) - this.view.depth(b.centre));
    for (const face of seen) this.drawFace(context, face);
    arrows.filter((arrow) => !behind(arrow)).forEach(draw);
  }

  drawFace(context, { corners, normal, shade }) {
    const light = 0.55 + 0.45 * Math.max(0, dot(normal, LIGHT));
    const rgb = [1, 3, 5].map((start) => Math.round(light * Number.parseInt(shade.slice(start, start + 2), 16)));
    context.fillStyle = `rgb(${rgb.join(", ")})`;
    context.strokeStyle = "rgba(0, 0, 0, .5)";
    context.lineWidth = 0.6;
    context.beginPath();
    for (const corner of corners) context.lineTo(...this.view.project(corner));
    context.closePath();
    context.fill();
    context.stroke();
  }

  drawLine(context, points, colour, width) {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    for (const point of points) context.lineTo(...this.view.project(point));
    context.stroke();
  }

  drawArrow(context, from, to, colour, width) {
    const [[x0, y0], [x1, y1]] = [this.view.project(from), this.view.project(to)];
    const length = Math.hypot(x1 - x0, y1 - y0);
    this.drawLine(context, [from, to], colour, width);
    if (length < 6) return; // it points at the viewer
    const [along, across] = [[(x1 - x0) / length, (y1 - y0) / length], [(y0 - y1) / length, (x1 - x0) / length]];
    const tip = 4 * width;
    context.fillStyle = colour;
    context.beginPath();
    context.moveTo(x1 + 2 * along[0], y1 + 2 * along[1]);
    for (const side of [1, -1]) {
      context.lineTo(x1 - tip * along[0] + (side * tip * across[0]) / 2, y1 - tip * along[1] + (side * tip * across[1]) / 2);
    }
    context.fill();
  }

  // Write the labels within the canvas, each moved down until it covers no other.
  drawLabels(context, width, height) {
    context.font = FONT;
    context.textAlign = "left";
    context.lineWidth = 3;
    context.strokeStyle = "#000000";
    const wished = this.labels.map(({ at, text, below }) => {
      const lines = text.split("\n");
      const [x, y] = this.view.project(at);
      const wide = Math.max(...lines.map((line) => context.measureText(line).width));
      return { left: x + 10, top: below ? y + 12 : y - 16, wide, high: 16 * lines.length };
    });
    placeLabels(wished, width, height).forEach(({ left, top }, number) => {
      const { text, colour } = this.labels[number];
      context.fillStyle = colour;
      text.split("\n").forEach((line, index) => {
        context.strokeText(line, left, top + 13 + 16 * index);
        context.fillText(line, left, top + 13 + 16 * index);
      });
    });
  }
}

// Directions to the right, up and to the viewer in RTN, and the place of a point on the canvas.
function makeView({ yaw, pitch }, width, height, range) {
  const [sy, cy, sp, cp] = [Math.sin(yaw), Math.cos(yaw), Math.sin(pitch), Math.cos(pitch)];
  const [right, up, toViewer] = [[0, cy, sy], [cp, -sp * sy, sp * cy], [sp, cp * sy, -cp * cy]];
  const scale = Math.min(width, height) / range;
  return {
    right, up, toViewer, scale,
    project: (point) => [width / 2 + scale * dot(point, right), height / 2 - scale * dot(point, up)],
    depth: (point) => dot(point, toViewer),
  };
}

// Corners, outward normal and centre in RTN of the six faces of a box in the frame of a spacecraft.
function facesOf(dimensions, centre, axes, at, size, shade) {
  const toRtn = (point) => at.map((value, axis) => value
    + size * (axes[0][axis] * point[0] + axes[1][axis] * point[1] + axes[2][axis] * point[2]));
  const faces = [];
  for (const axis of [0, 1, 2]) {
    for (const side of [1, -1]) {
      const [second, third] = [(axis + 1) % 3, (axis + 2) % 3];
      const corner = (a, b) => {
        const point = [...centre];
        point[axis] += (side * dimensions[axis]) / 2;
        point[second] += (a * dimensions[second]) / 2;
        point[third] += (b * dimensions[third]) / 2;
        return toRtn(point);
      };
      faces.push({
        corners: [corner(1, 1), corner(-1, 1), corner(-1, -1), corner(1, -1)],
        centre: corner(0, 0), normal: axes[axis].map((value) => side * value), shade,
      });
    }
  }
  return faces;
}

// Body axes in RTN of a rotation from the body to RTN, as a unit quaternion x, y, z, w.
function columnsOf([x, y, z, w]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
    [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
  ];
}

// Largest eigenvalue of a symmetric 3 x 3 matrix (Smith 1961, Communications of the ACM 4(4)).
function largestVariance(m) {
  const mean = (m[0][0] + m[1][1] + m[2][2]) / 3;
  const off = m[0][1] ** 2 + m[0][2] ** 2 + m[1][2] ** 2;
  const spread = Math.sqrt((m.reduce((sum, row, axis) => sum + (row[axis] - mean) ** 2, 0) + 2 * off) / 6);
  if (!(spread > 0)) return mean;
  const b = m.map((row, i) => row.map((value, j) => (value - (i === j ? mean : 0)) / spread));
  const determinant = dot(b[0], [
    b[1][1] * b[2][2] - b[1][2] * b[2][1], b[1][2] * b[2][0] - b[1][0] * b[2][2], b[1][0] * b[2][1] - b[1][1] * b[2][0],
  ]);
  return mean + 2 * spread * Math.cos(Math.acos(Math.min(Math.max(determinant / 2, -1), 1)) / 3);
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
