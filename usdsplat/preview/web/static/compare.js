// Two looks side by side, with a wipe between them that can be dragged.

import { made } from "./knobs.js";

const at = (id) => document.getElementById(id);
const STEP = 0.02; // of a key, as a fraction of the picture's width

export class Compare {
  /** @param {import("./viewport.js").Viewport} viewport
   *  @param {(type: string, members?: object) => void} send */
  constructor(viewport, send) {
    Object.assign(this, { viewport, send });
    this.other = null;
    this.part = 0.5;
    viewport.placed = () => this.place();
    at("compare-on").addEventListener("change", () => this.turn());
    at("compare-aov").addEventListener("change", () => this.turn());
    at("compare-time").addEventListener("change", () => this.turn());
    at("compare-time").addEventListener("keydown", (event) => event.stopPropagation());
    const wipe = at("wipe");
    wipe.addEventListener("pointerdown", (event) => wipe.setPointerCapture(event.pointerId));
    wipe.addEventListener("pointermove", (event) => {
      if (!wipe.hasPointerCapture(event.pointerId)) return;
      const box = viewport.element.getBoundingClientRect();
      const { left, width } = viewport.content;
      this.move((event.clientX - box.left - left) / width);
    });
    wipe.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: -STEP, ArrowRight: STEP }[event.code];
      if (!way) return;
      event.preventDefault();
      event.stopPropagation();
      this.move(this.part + way);
    });
  }

  offer(aovs) {
    at("compare-aov").replaceChildren(...aovs.map((aov) => new Option(aov.name, aov.name)));
  }

  toggle() {
    at("compare-on").checked = this.other === null;
    this.turn();
  }

  turn() {
    const time = at("compare-time").value;
    this.send("set_other", {
      aov: at("compare-on").checked ? at("compare-aov").value : null,
      time: time === "" ? null : Number(time),
    });
  }

  move(part) {
    this.part = Math.min(Math.max(part, 0), 1);
    this.place();
    if (this.isSending) return;
    this.isSending = true; // at most one message per screen frame
    requestAnimationFrame(() => {
      this.isSending = false;
      this.send("set_wipe", { part: this.part });
    });
  }

  place() {
    const { left, width } = this.viewport.content;
    at("wipe").style.left = `${left + this.part * width}px`;
    at("wipe").ariaValueNow = String(Math.round(100 * this.part));
  }

  show({ other, wipe, aov }) {
    const wasOff = this.other === null;
    this.other = other;
    at("compare-on").checked = other !== null;
    at("wipe").hidden = other === null;
    if (other === null) {
      if (wasOff && document.activeElement !== at("compare-aov")) at("compare-aov").value = aov;
      return;
    }
    at("compare-aov").value = other.aov;
    if (document.activeElement !== at("compare-time")) at("compare-time").value = other.time ?? "";
    if (!this.isSending) this.part = wipe;
    this.place();
    const names = [aov, other.time === null ? other.aov : `${other.aov} · frame ${other.time}`];
    at("wipe").replaceChildren(...names.map((name, index) => made("span", { textContent: `${"AB"[index]} · ${name}` })));
  }
}
