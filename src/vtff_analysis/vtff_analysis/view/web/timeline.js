// Time of the scene: plays, pauses, jumps. In a live scene it may stay at the newest sample.

export class Timeline extends EventTarget {
  constructor(scene) {
    super();
    this.scene = scene;
    this.time = 0;
    this.rate = 30;
    this.playing = false;
    this.following = scene.live;
    if (scene.live) this.time = scene.duration;
    this.before = null;
  }

  play() {
    if (this.time >= this.scene.duration) this.time = 0;
    this.following = false;
    this.playing = true;
    this.changed();
  }

  pause() {
    this.playing = false;
    this.following = false;
    this.changed();
  }

  follow() {
    this.playing = false;
    this.following = true;
    this.changed();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.scene.duration);
    this.following = false;
    this.changed();
  }

  // Advance to a moment of the wall clock, ms.
  advance(now) {
    const elapsed = this.before === null ? 0 : Math.min((now - this.before) / 1000, 0.5);
    this.before = now;
    if (this.following) {
      this.time = this.scene.duration;
    } else if (this.playing) {
      this.time += elapsed * this.rate;
      if (this.time >= this.scene.duration) {
        this.time = this.scene.duration;
        this.playing = false;
        this.changed();
      }
    }
  }

  changed() {
    this.dispatchEvent(new Event("change"));
  }
}

export function bindControls(timeline, elements, command) {
  const { play, speed, scrub, follow } = elements;
  const show = () => {
    play.textContent = timeline.playing ? "Pause" : "Play";
    follow.setAttribute("aria-pressed", String(timeline.following));
  };
  const toggle = () => {
    if (timeline.playing || timeline.following) timeline.pause();
    else timeline.play();
  };
  timeline.addEventListener("change", show);
  play.addEventListener("click", toggle);
  speed.addEventListener("change", () => {
    timeline.rate = Number(speed.value);
    command("rate", timeline.rate);
  });
  scrub.addEventListener("input", () => timeline.seek(Number(scrub.value)));
  scrub.addEventListener("change", () => command("seek", Number(scrub.value)));
  follow.addEventListener("click", () => timeline.follow());
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("input, select, button")) return;
    if (event.key === " ") {
      event.preventDefault();
      toggle();
    } else if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
      timeline.seek(timeline.time + (event.key === "ArrowLeft" ? -10 : 10));
    }
  });
  show();
}
