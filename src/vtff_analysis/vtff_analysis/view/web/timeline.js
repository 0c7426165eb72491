// Time of the scene: plays, pauses, jumps. In a live scene it may stay at the newest sample.

const JUMP = 10; // s that an arrow key moves; with shift 1 s

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
    this.passed = []; // [ms of wall clock, s of scene] of the last seconds
  }

  get moving() {
    return this.playing || this.following;
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

  toggle() {
    if (this.moving) this.pause();
    else this.play();
  }

  follow() {
    this.playing = false;
    this.following = true;
    this.changed();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.scene.duration);
    this.following = false;
    this.passed = [];
    this.changed();
  }

  // Go to the next event, or to the one before.
  seekEvent(forward) {
    const times = this.scene.events.map((event) => event.time);
    const next = forward ? times.find((time) => time > this.time + 0.01)
      : times.findLast((time) => time < this.time - 0.01);
    if (next !== undefined) this.seek(next);
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
    this.passed.push([now, this.time]);
    while (now - this.passed[0][0] > 4000) this.passed.shift();
  }

  // Scenario seconds for each second of the wall clock, over the last four; null while it stands.
  get trueRate() {
    const [first, last] = [this.passed[0], this.passed.at(-1)];
    if (!this.moving || !first || last[0] - first[0] < 500) return null;
    return (1000 * (last[1] - first[1])) / (last[0] - first[0]);
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
  timeline.addEventListener("change", show);
  play.addEventListener("click", () => {
    command(timeline.playing ? "pause" : "resume");
    timeline.toggle();
  });
  speed.addEventListener("change", () => {
    timeline.rate = Number(speed.value);
    command("rate", timeline.rate);
  });
  scrub.addEventListener("input", () => timeline.seek(Number(scrub.value)));
  scrub.addEventListener("change", () => command("seek", Number(scrub.value)));
  follow.addEventListener("click", () => timeline.follow());
  show();
}

// Keys work wherever the focus is, but where text is typed; `others` has more of them by key.
export function bindKeys(timeline, others) {
  const keys = {
    " ": () => timeline.toggle(),
    ArrowLeft: (event) => timeline.seek(timeline.time - (event.shiftKey ? 1 : JUMP)),
    ArrowRight: (event) => timeline.seek(timeline.time + (event.shiftKey ? 1 : JUMP)),
    Home: () => timeline.seek(0),
    End: () => timeline.seek(timeline.scene.duration),
    n: () => timeline.seekEvent(true),
    p: () => timeline.seekEvent(false),
    ...others,
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.target.closest("input:not([type=range]), textarea")) return;
    const act = keys[event.key];
    if (!act) return;
    event.preventDefault(); // a button or slider that has the focus does not act as well
    act(event);
  }, { capture: true });
  // Space on a button that has the focus would press it when the key goes up.
  document.addEventListener("keyup", (event) => {
    if (event.key === " " && event.target.closest("button")) event.preventDefault();
  }, { capture: true });
}

// Marks of the events above the slider; a click goes there.
export function drawMarks(container, timeline) {
  const { scene } = timeline;
  const marks = scene.events.map((event) => {
    const mark = document.createElement("button");
    mark.className = `mark ${event.kind}`;
    mark.style.left = `${(100 * event.time) / Math.max(scene.duration, 1e-3)}%`;
    mark.title = `${event.time.toFixed(1)} s: ${event.text}`;
    mark.setAttribute("aria-label", mark.title);
    mark.tabIndex = -1; // there may be hundreds; n and p go through them
    mark.addEventListener("click", () => timeline.seek(event.time));
    return mark;
  });
  container.replaceChildren(...marks);
}
