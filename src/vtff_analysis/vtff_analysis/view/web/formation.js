// The formation close up, drawn by Cesium in the chief's RTN frame: axes with a round length,
// baselines with theirs, spacecraft, thrust, 3-sigma ellipsoids, keep-out sphere, trails.
// Spacecraft and ellipsoids are drawn larger than they are, so that they are seen at any distance.

import { lengthText, placeLabels } from "./canvas.js";
import { CHIEF, craftColour } from "./colours.js";
import {
  ALONE_SHARE, ARROW_SIZES, ATTITUDE_ARROWS, AXIS_COLOURS, BODY_BOX, CRAFT_SHARE, ELLIPSOID_SHARE, KEEP_OUT_COLOUR,
  LARGEST_RANGE, PANEL_BOXES, PANEL_COLOUR, SIGMAS, THRUST_SHARE, attitudeDirections, axisLength, covarianceAt,
  deputyText, largestDistance, largestThrust, magnification, placeAt, thrustAt, trailOf,
} from "./craft.js";
import { Scene } from "./scene.js";

const FONT = "600 13px sans-serif";
const LINE_HEIGHT = 18; // pixels

export class FormationView {
  constructor(Cesium, scene, view) {
    this.Cesium = Cesium;
    this.scene = scene;
    this.view = view;
    this.shown = false;
    this.measure = document.createElement("canvas").getContext("2d");
    this.measure.font = FONT;
    this.lines = view.primitives.add(new Cesium.PolylineCollection());
    this.labels = view.primitives.add(new Cesium.LabelCollection());
    this.solids = view.primitives.add(new Cesium.PrimitiveCollection());
    this.deputies = new Map();
    this.largestThrust = 0;
    this.axes = AXIS_COLOURS.map((colour) => this.makeArrow(colour, 7));
    this.axisLabels = AXIS_COLOURS.map((colour) => this.makeLabel(colour));
    this.chief = this.makeCraft(CHIEF);
    this.chiefLabel = this.makeLabel(CHIEF);
    this.keepOut = this.makeSphere(KEEP_OUT_COLOUR);
    this.attitudes = new Map();
    this.update();
    this.show(false);
  }

  show(shown) {
    this.shown = shown;
    this.lines.show = shown;
    this.labels.show = shown;
    this.solids.show = shown;
  }

  update() {
    const crafts = this.scene.spacecraft();
    for (const { deputy, series } of this.scene.deputies()) {
      if (!this.deputies.has(deputy)) {
        const colour = craftColour(crafts.includes(deputy) ? crafts.indexOf(deputy) : 1);
        this.deputies.set(deputy, {
          colour, craft: this.makeCraft(colour), arrow: this.makeArrow("#ffffff", 10),
          baseline: this.makeLine("#ffffff", 0.55, 1.5), trail: this.makeLine(colour, 0.9, 2),
          ellipsoid: this.makeSphere(colour), label: this.makeLabel(colour),
          length: this.makeLabel("#ffffff"),
        });
      }
      const parts = this.deputies.get(deputy);
      parts.series = series;
      parts.trail.positions = this.trail(series);
    }
    this.largestThrust = largestThrust(this.scene);
  }

  // Distance in m from which the whole formation is seen at a time.
  fittingRange(time) {
    const { clientWidth, clientHeight } = this.view.canvas;
    const narrow = Math.max(1, clientHeight / Math.max(clientWidth, 1)); // a phone sees less to the sides
    return Math.min(2.6 * narrow * largestDistance(this.scene, time), LARGEST_RANGE);
  }

  // Matrix from the RTN frame of the chief to ITRF at a time; null where there is no orbit.
  frame(time) {
    const { Cesium } = this;
    const [chief] = this.scene.spacecraft();
    const orbit = chief && this.scene.orbit(chief);
    const axes = orbit && Scene.rtnAxes(orbit, time);
    if (!axes) return null;
    const [r, t, n] = axes;
    const rotation = new Cesium.Matrix3(r[0], t[0], n[0], r[1], t[1], n[1], r[2], t[2], n[2]);
    return Cesium.Matrix4.fromRotationTranslation(rotation, new Cesium.Cartesian3(...orbit.positionAt(time)));
  }

  // Draw at a time, seen from a distance in m.
  draw(time, range) {
    const { Cesium } = this;
    const frame = this.shown ? this.frame(time) : null;
    if (!frame) return;
    this.lines.modelMatrix = frame;
    this.labels.modelMatrix = frame;
    const size = (this.deputies.size ? CRAFT_SHARE : ALONE_SHARE) * range;
    this.drawAxes(range);
    const [chief] = this.scene.spacecraft();
    place(Cesium, this.chief, frame, [0, 0, 0], size, this.drawAttitude(chief, [0, 0, 0], time, size));
    this.chiefLabel.position = this.cartesians([[0, 0, 0]])[0];
    this.chiefLabel.text = this.deputies.size ? chief : "";
    this.keepOut.show = this.scene.hardRadius > 0 && this.scene.hardRadius < range;
    place(Cesium, this.keepOut, frame, [0, 0, 0], this.scene.hardRadius);
    for (const [deputy, parts] of this.deputies) {
      const at = placeAt(parts.series, time);
      if (at) this.drawDeputy(deputy, parts, frame, at, time, range);
    }
    this.arrangeLabels(frame);
  }

  // Move the labels until none covers another or is cut by the edge of the pane.
  arrangeLabels(frame) {
    const { Cesium, view } = this;
    const { clientWidth, clientHeight } = view.canvas;
    const shown = [];
    for (let index = 0; index < this.labels.length; index += 1) {
      const label = this.labels.get(index);
      const world = Cesium.Matrix4.multiplyByPoint(frame, label.position, new Cesium.Cartesian3());
      const at = label.show && label.text && Cesium.SceneTransforms.worldToWindowCoordinates(view, world);
      if (!at || at.x < 0 || at.x > clientWidth || at.y < 0 || at.y > clientHeight) continue;
      const lines = label.text.split("\n");
      const wide = Math.max(...lines.map((line) => this.measure.measureText(line).width)) + 6;
      const high = LINE_HEIGHT * lines.length;
      shown.push({ label, at, left: at.x + 10, top: label === this.chiefLabel ? at.y + 14 : at.y - 4 - high, wide, high });
    }
    placeLabels(shown, clientWidth, clientHeight).forEach(({ left, top }, number) => {
      const { label, at } = shown[number];
      label.pixelOffset = new Cesium.Cartesian2(left - at.x, top - at.y);
    });
  }

  drawAxes(range) {
    const length = axisLength(range);
    ["R", "T", "N"].forEach((name, axis) => {
      const end = [0, 0, 0];
      end[axis] = length;
      this.axes[axis].positions = this.cartesians([[0, 0, 0], end]);
      this.axisLabels[axis].position = this.cartesians([end])[0];
      this.axisLabels[axis].text = axis ? name : `${name} ${lengthText(length)}`;
    });
  }

  drawDeputy(deputy, parts, frame, at, time, range) {
    const { Cesium } = this;
    const size = CRAFT_SHARE * range;
    place(Cesium, parts.craft, frame, at, size, this.drawAttitude(deputy, at, time, size));
    parts.baseline.positions = this.cartesians([[0, 0, 0], at]);
    const [position, middle] = this.cartesians([at, at.map((value) => value / 2)]);
    parts.length.position = middle;
    parts.length.text = lengthText(Math.hypot(...at), 6);
    parts.label.position = position;
    const force = thrustAt(this.scene, deputy, time);
    const strength = Math.hypot(...force);
    parts.arrow.show = strength > 1e-3 * this.largestThrust;
    if (parts.arrow.show) {
      const scale = (THRUST_SHARE * range) / this.largestThrust;
      parts.arrow.positions = this.cartesians([at, at.map((value, axis) => value + scale * force[axis])]);
    }
    const ellipsoid = this.covariance(deputy, time);
    parts.ellipsoid.show = ellipsoid !== null;
    let text = deputy;
    if (ellipsoid) {
      const largest = SIGMAS * Math.sqrt(Math.max(...ellipsoid.variances));
      const factor = magnification(ELLIPSOID_SHARE * range, largest);
      const radii = ellipsoid.variances.map((value) => Math.max(factor * SIGMAS * Math.sqrt(Math.max(value, 0)), 1e-3 * size));
      const local = Cesium.Matrix4.fromRotationTranslation(ellipsoid.axes, position);
      const scaled = Cesium.Matrix4.multiplyByScale(local, new Cesium.Cartesian3(...radii), new Cesium.Matrix4());
      parts.ellipsoid.modelMatrix = Cesium.Matrix4.multiply(frame, scaled, new Cesium.Matrix4());
      text = deputyText(deputy, largest, factor);
    }
    parts.label.text = text;
  }

  // Draw the body axes of a spacecraft, the magnetic field and the nadir; return the rotation of its
  // model, null where there is no attitude.
  drawAttitude(craft, at, time, size) {
    const { Cesium } = this;
    const attitude = this.scene.attitudeAt(craft, time);
    if (!attitude) return null;
    if (!this.attitudes.has(craft)) {
      this.attitudes.set(craft, ATTITUDE_ARROWS.map(({ name, colour }) => ({
        name, arrow: this.makeArrow(colour, 8), label: this.makeLabel(colour),
      })));
    }
    const body = Cesium.Matrix3.fromQuaternion(new Cesium.Quaternion(...attitude.quaternion));
    const directions = attitudeDirections([0, 1, 2].map((index) => column(body, index)), attitude.field);
    for (const { name, arrow, label } of this.attitudes.get(craft)) {
      const direction = directions[name];
      arrow.show = direction !== null;
      label.show = arrow.show;
      if (!arrow.show) continue;
      const [from, to] = this.cartesians([at, at.map((value, axis) => value + ARROW_SIZES * size * direction[axis])]);
      arrow.positions = [from, to];
      label.position = to;
      label.text = name;
    }
    return Cesium.Matrix3.multiply(body, modelToBody(Cesium), new Cesium.Matrix3());
  }

  // Variances along their axes and the axes of the covariance of a deputy at a time; or null.
  covariance(deputy, time) {
    const { Cesium } = this;
    const covariance = covarianceAt(this.scene, deputy, time);
    if (!covariance) return null;
    const scale = Math.max(...covariance.map((row, axis) => row[axis]));
    const matrix = new Cesium.Matrix3(...covariance.flat().map((value) => value / scale));
    const { unitary, diagonal } = Cesium.Matrix3.computeEigenDecomposition(matrix);
    return { variances: [0, 4, 8].map((index) => scale * diagonal[index]), axes: unitary };
  }

  trail(series) {
    const points = trailOf(series);
    return points.length > 1 ? this.cartesians(points) : [];
  }

  cartesians(points) {
    return points.map(([x, y, z]) => new this.Cesium.Cartesian3(x, y, z));
  }

  makeLine(colour, alpha, width) {
    const { Cesium } = this;
    const material = Cesium.Material.fromType("Color", {
      color: Cesium.Color.fromCssColorString(colour).withAlpha(alpha),
    });
    return this.lines.add({ width, material });
  }

  makeArrow(colour, width) {
    const { Cesium } = this;
    const material = Cesium.Material.fromType("PolylineArrow", { color: Cesium.Color.fromCssColorString(colour) });
    return this.lines.add({ width, material });
  }

  makeLabel(colour) {
    const { Cesium } = this;
    return this.labels.add({
      text: "", font: FONT, verticalOrigin: Cesium.VerticalOrigin.TOP, fillColor: Cesium.Color.fromCssColorString(colour),
      outlineColor: Cesium.Color.BLACK, outlineWidth: 3, style: Cesium.LabelStyle.FILL_AND_OUTLINE,
      pixelOffset: new Cesium.Cartesian2(10, -10), disableDepthTestDistance: Infinity,
    });
  }

  // A wire sphere of radius 1.
  makeSphere(colour) {
    const { Cesium } = this;
    return this.solids.add(new Cesium.Primitive({
      asynchronous: false,
      geometryInstances: new Cesium.GeometryInstance({
        geometry: new Cesium.EllipsoidOutlineGeometry({
          radii: new Cesium.Cartesian3(1, 1, 1), stackPartitions: 8, slicePartitions: 10,
        }),
        attributes: { color: Cesium.ColorGeometryInstanceAttribute.fromColor(
          Cesium.Color.fromCssColorString(colour).withAlpha(0.6)) },
      }),
      appearance: new Cesium.PerInstanceColorAppearance({ flat: true, translucent: true }),
    }));
  }

  // A body with two solar panels, of size 1 along the in-track axis.
  makeCraft(colour) {
    const { Cesium } = this;
    const box = (size, centre, shade) => new Cesium.GeometryInstance({
      geometry: Cesium.BoxGeometry.fromDimensions({
        dimensions: new Cesium.Cartesian3(...size),
        vertexFormat: Cesium.PerInstanceColorAppearance.VERTEX_FORMAT,
      }),
      modelMatrix: Cesium.Matrix4.fromTranslation(new Cesium.Cartesian3(...centre)),
      attributes: { color: Cesium.ColorGeometryInstanceAttribute.fromColor(shade) },
    });
    const body = Cesium.Color.fromCssColorString(colour);
    const panel = Cesium.Color.fromCssColorString(PANEL_COLOUR);
    return this.solids.add(new Cesium.Primitive({
      asynchronous: false,
      geometryInstances: [
        box(...BODY_BOX, body), ...PANEL_BOXES.map((part) => box(...part, panel)),
      ],
      appearance: new Cesium.PerInstanceColorAppearance({ flat: false, translucent: false, closed: true }),
    }));
  }
}

// The model is drawn along R, T and N; these are -z, x and -y of a body that points at the Earth.
function modelToBody(Cesium) {
  return new Cesium.Matrix3(0, 1, 0, 0, 0, -1, -1, 0, 0);
}

function column(matrix, index) {
  return [matrix[3 * index], matrix[3 * index + 1], matrix[3 * index + 2]];
}

function place(Cesium, primitive, frame, at, size, rotation = null) {
  const local = Cesium.Matrix4.fromRotationTranslation(rotation ?? Cesium.Matrix3.IDENTITY, new Cesium.Cartesian3(...at));
  Cesium.Matrix4.multiplyByUniformScale(local, Math.max(size, 1e-6), local);
  primitive.modelMatrix = Cesium.Matrix4.multiply(frame, local, new Cesium.Matrix4());
}
