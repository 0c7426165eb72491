// What both close views of the formation, the one on the globe and the one without it, agree upon:
// sizes, colours, the model of a spacecraft, its attitude arrows, places between samples.

import { lengthText, niceTicks } from "./canvas.js";

export const CRAFT_SHARE = 1 / 18; // of the distance that is seen: size of a spacecraft
export const ALONE_SHARE = 1 / 4; // the same of a spacecraft that flies alone: its attitude is what is seen
export const ELLIPSOID_SHARE = 1 / 6; // largest half axis of an ellipsoid
export const THRUST_SHARE = 1 / 5; // the largest thrust of the scene
export const LARGEST_RANGE = 4e5; // m: formations of 100 km still fit
export const AXIS_COLOURS = ["#5fb3ff", "#ff9a4d", "#4fd8a8"]; // radial, in-track, cross-track; before the sky
export const KEEP_OUT_COLOUR = "#ff6b6b";
export const SIGMAS = 3;
export const ARROW_SIZES = 1.1; // length of an attitude arrow in sizes of the spacecraft
const AXIS_SHARE = 1 / 4;

// A body with two solar panels, of size 1 along the in-track axis: sizes and centres of its boxes.
export const BODY_BOX = [[0.35, 0.45, 0.35], [0, 0, 0]];
export const PANEL_BOXES = [[[0.02, 0.4, 0.6], [0, 0, 0.52]], [[0.02, 0.4, 0.6], [0, 0, -0.52]]];
export const PANEL_COLOUR = "#23406e";

// Body axes, the magnetic field and the direction to the Earth.
export const ATTITUDE_ARROWS = [
  { name: "x", colour: "#ffd166" }, { name: "y", colour: "#c9a7ff" }, { name: "z", colour: "#ff8fab" },
  { name: "B", colour: "#9be564" }, { name: "nadir", colour: "#b8c4d0" },
];

// Directions of the attitude arrows in RTN by their names; `columns` are the body axes in RTN.
export function attitudeDirections(columns, field) {
  const [x, y, z] = columns;
  return { x, y, z, B: field, nadir: [-1, 0, 0] };
}

// Relative position at a time, straight between samples; null before the first.
export function placeAt(series, time) {
  const index = series.indexAt(time);
  if (index < 0) return null;
  const next = Math.min(index + 1, series.time.length - 1);
  const part = next > index ? Math.min((time - series.time[index]) / (series.time[next] - series.time[index]), 1) : 0;
  return ["radial", "in_track", "cross_track"].map((axis) => {
    const column = series.columns[axis];
    return column[index] + part * (column[next] - column[index]);
  });
}

// Distance in m to the farthest deputy at a time; 1 without any.
export function largestDistance(scene, time) {
  let largest = 1;
  for (const { series } of scene.deputies()) {
    const place = placeAt(series, time);
    if (place) largest = Math.max(largest, Math.hypot(...place));
  }
  return largest;
}

// Points of the way of a deputy, at most some 1500.
export function trailOf(series) {
  const { radial, in_track: along, cross_track: across } = series.columns;
  const step = Math.max(1, Math.floor(radial.length / 1500));
  const points = [];
  for (let index = 0; index < radial.length; index += step) points.push([radial[index], along[index], across[index]]);
  return points;
}

// Thrust of a deputy: what was applied, or else what was commanded.
export function thrustOf(scene, deputy) {
  return scene.get("thrust", deputy, "applied") ?? scene.get("thrust", deputy, "command");
}

// The largest thrust of all deputies.
export function largestThrust(scene) {
  let largest = 0;
  for (const { deputy } of scene.deputies()) {
    const { radial, in_track: along, cross_track: across } = thrustOf(scene, deputy)?.columns ?? { radial: [] };
    radial.forEach((value, index) => { largest = Math.max(largest, Math.hypot(value, along[index], across[index])); });
  }
  return largest;
}

// Thrust vector of a deputy at a time; zeros without any.
export function thrustAt(scene, deputy, time) {
  const sample = thrustOf(scene, deputy)?.sampleAt(time, 30);
  return sample ? [sample.radial, sample.in_track, sample.cross_track] : [0, 0, 0];
}

// Covariance of the position of a deputy at a time, rows of a symmetric matrix in m2; or null.
export function covarianceAt(scene, deputy, time) {
  const sample = scene.get("covariance", deputy)?.sampleAt(time, 30);
  if (!sample || sample.rr === null) return null;
  const { rr, rt, rn, tt, tn, nn } = sample;
  return Math.max(rr, tt, nn) > 0 ? [[rr, rt, rn], [rt, tt, tn], [rn, tn, nn]] : null;
}

// Power of ten by which a length is enlarged to be about as long as wished; at least 1.
export function magnification(wished, length) {
  return length > 0 ? 10 ** Math.max(0, Math.floor(Math.log10(wished / length))) : 1;
}

// Round length of the axes that suits a distance.
export function axisLength(range) {
  return niceTicks(0, AXIS_SHARE * range, 1.5).ticks.at(-1) || AXIS_SHARE * range;
}

// Name of a deputy with the size of its ellipsoid.
export function deputyText(deputy, halfAxis, factor) {
  return `${deputy}\n3 sigma ${lengthText(halfAxis, 3)}${factor > 1 ? `, drawn x ${factor}` : ""}`;
}
