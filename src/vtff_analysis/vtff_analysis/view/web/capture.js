// Picture and video of the page: its canvases as they stand, with name and time, in one canvas.

import { page } from "./colours.js";

const FRAMES = 15; // per second of a video
const HEADER = 26; // pixels above for name and time

export class Capture {
  constructor(main, describe, panels) {
    this.main = main; // element that holds the canvases
    this.describe = describe; // function: text of the first line
    this.panels = panels; // function: panels of which some must draw anew to be read
    this.canvas = document.createElement("canvas");
    this.recorder = null;
  }

  // Copy what is shown.
  compose() {
    const bounds = this.main.getBoundingClientRect();
    const scale = window.devicePixelRatio || 1;
    const [width, height] = [Math.round(bounds.width * scale), Math.round((bounds.height + HEADER) * scale)];
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    const context = this.canvas.getContext("2d");
    context.setTransform(scale, 0, 0, scale, 0, 0);
    context.fillStyle = page().paper;
    context.fillRect(0, 0, bounds.width, bounds.height + HEADER);
    context.fillStyle = page().ink;
    context.font = "600 13px system-ui, sans-serif";
    context.fillText(this.describe(), 8, 18);
    for (const panel of this.panels()) panel.redraw?.(); // WebGL is read while its picture is new
    for (const canvas of this.main.querySelectorAll("canvas")) {
      if (canvas.hidden || canvas.closest("[hidden], #legend") || !canvas.clientWidth) continue;
      const box = canvas.getBoundingClientRect();
      context.drawImage(canvas, box.left - bounds.left, box.top - bounds.top + HEADER, box.width, box.height);
    }
  }

  savePicture(name) {
    this.compose();
    return new Promise((resolve) => {
      this.canvas.toBlob((blob) => {
        save(blob, `${name}.png`);
        resolve(blob.size);
      }, "image/png");
    });
  }

  get recording() {
    return this.recorder !== null;
  }

  // Record until it is called again; the file is saved then.
  toggleVideo(name) {
    if (this.recorder) {
      this.recorder.stop();
      return;
    }
    this.compose();
    const recorder = new MediaRecorder(this.canvas.captureStream(FRAMES), { mimeType: "video/webm" });
    const parts = [];
    const timer = setInterval(() => this.compose(), 1000 / FRAMES);
    recorder.ondataavailable = (event) => parts.push(event.data);
    recorder.onstop = () => {
      clearInterval(timer);
      this.recorder = null;
      this.saved = new Blob(parts, { type: "video/webm" });
      save(this.saved, `${name}.webm`);
    };
    recorder.start(1000);
    this.recorder = recorder;
  }
}

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
