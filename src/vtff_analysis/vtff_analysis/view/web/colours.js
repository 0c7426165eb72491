// Colours that are told apart with any colour vision: Okabe-Ito for names, cividis for amounts.
// What is drawn on the page itself has two sets, for a light and for a dark page.

export const CHIEF = "#56b4e9";
export const DEPUTY = "#e69f00";
export const OTHERS = ["#cc79a7", "#009e73", "#f0e442"];
export const AXIS_DASHES = [[], [], [6, 3]];
export const REGION = "#cc79a7";
export const WALL = "#f0e442"; // walls of plasma as a survey knows them
export const WALL_LATITUDE = 25; // deg to which they are drawn
export const BESIDE = "#8a929b"; // the second run

export const CN0_RANGE = [30, 50]; // dB-Hz
export const S4_RANGE = [0, 1];

const PAGES = {
  light: {
    ink: "#1b1f24", faint: "#5b6470", grid: "#e3e7eb", frame: "#9aa4af", paper: "#ffffff",
    past: "#c5ccd3", cursor: "#444444",
    axes: ["#0072b2", "#d55e00", "#007a5a"], // radial, in-track, cross-track
    lines: ["#0072b2", "#d55e00", "#007a5a", "#cc79a7", "#56b4e9", "#8a6d00", "#444444"],
  },
  dark: {
    ink: "#e8ecf0", faint: "#a3adb8", grid: "#2c343c", frame: "#66707b", paper: "#14181c",
    past: "#4c555f", cursor: "#cfd6dd",
    axes: ["#56b4e9", "#f0913c", "#2fc79a"],
    lines: ["#56b4e9", "#f0913c", "#2fc79a", "#e3a1c4", "#9ad3f5", "#e3c94a", "#c9cfd6"],
  },
};

const darkness = window.matchMedia("(prefers-color-scheme: dark)");

let alwaysLight = false;

// Draw on white in dark browsers too: the lines have the colours of printed figures.
export function stayLight() {
  alwaysLight = true;
}

// Colours of the page as it is shown now.
export function page() {
  return darkness.matches && !alwaysLight ? PAGES.dark : PAGES.light;
}

export function onPageChange(listener) {
  darkness.addEventListener("change", listener);
}

// Colour of a spacecraft by its place among all, the chief being the first.
export function craftColour(index) {
  if (index <= 0) return CHIEF;
  return index === 1 ? DEPUTY : OTHERS[(index - 2) % OTHERS.length];
}

// Cividis at equal steps (Nunez, Anderton and Renslow 2018), without its dark end, which would
// not be seen before the sky.
const CIVIDIS = [
  [59, 73, 108], [87, 93, 109], [112, 113, 115], [138, 134, 120],
  [165, 156, 116], [195, 179, 105], [225, 204, 85], [254, 232, 56],
];

// Red, green, blue, 0 to 255, of a part 0 to 1.
export function cividis(part) {
  const place = Math.min(Math.max(part, 0), 1) * (CIVIDIS.length - 1);
  const index = Math.min(Math.floor(place), CIVIDIS.length - 2);
  const rest = place - index;
  return CIVIDIS[index].map((v, i) => Math.round(v + rest * (CIVIDIS[index + 1][i] - v)));
}

export function partOf(value, [low, high]) {
  return (value - low) / (high - low || 1);
}

export function css(rgb) {
  return `rgb(${rgb.join(", ")})`;
}
