// The timeline: play, step, scrub, range, and the simulated frames.

const at = (id) => document.getElementById(id);

export class Timeline {
  /** @param {(type: string, members?: object) => void} send */
  constructor(send) {
    this.send = send;
    this.state = { time: 0, start: 0, end: 0, is_playing: false };
    at("play").addEventListener("click", () => this.toggle());
    at("back").addEventListener("click", () => send("advance", { frames: -1 }));
    at("forth").addEventListener("click", () => send("advance", { frames: 1 }));
    at("first").addEventListener("click", () => send("set_time", { time: this.state.start }));
    at("time").addEventListener("input", () => this.scrub());
    at("time").addEventListener("change", () => send("end_move"));
    at("loops").addEventListener("change", () => send("set_loops", { loops: at("loops").checked }));
    committed(at("current"), (time) => send("set_time", { time }));
    for (const id of ["start", "end"]) committed(at(id), () => this.narrow());
  }

  toggle() {
    this.send("play", { is_playing: !this.state.is_playing });
  }

  scrub() {
    at("current").value = at("time").value;
    this.send("set_time", { time: Number(at("time").value), is_scrubbing: true });
  }

  narrow() {
    this.send("set_range", { start: Number(at("start").value), end: Number(at("end").value) });
  }

  show(state) {
    this.state = state;
    at("timeline").hidden = state.end <= state.start;
    const slider = at("time");
    Object.assign(slider, { min: state.start, max: state.end, step: state.step });
    const focused = document.activeElement;
    if (focused !== slider || state.is_playing) slider.value = state.time;
    if (focused !== at("current")) at("current").value = state.time;
    if (focused !== at("start")) at("start").value = state.start;
    if (focused !== at("end")) at("end").value = state.end;
    at("loops").checked = state.loops;
    at("play").textContent = state.is_playing ? "❚❚" : "▶";
    at("play").ariaLabel = state.is_playing ? "Stop" : "Play";
    at("rate").textContent = `${state.rate} fps`;
  }

  /** Mark the frames that can be shown. */
  mark(frames) {
    const { start, end } = this.state;
    const part = (time) => Math.min(Math.max((time - start) / (end - start), 0), 1) * 100;
    at("made").hidden = !frames || end <= start;
    if (!frames) return;
    at("made").style.left = `${part(frames[0])}%`;
    at("made").style.width = `${part(frames[1]) - part(frames[0])}%`;
  }
}

function committed(field, commit) {
  field.addEventListener("change", () => field.value !== "" && commit(Number(field.value)));
  field.addEventListener("keydown", (event) => event.stopPropagation());
}
