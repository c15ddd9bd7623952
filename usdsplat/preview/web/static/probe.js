// The values under the pointer, and the histogram of the picture.

import { made, short } from "./knobs.js";

const COLORS = ["#e0645a", "#64b46e", "#5a8ce6"];

export class Probe {
  /** @param {(type: string, members?: object) => void} send */
  constructor(panel, swatch, list, send) {
    Object.assign(this, { panel, swatch, list, send });
    this.isAsking = false;
    this.next = null;
  }

  /** Ask for the values of a place, after the current answer. */
  follow(place) {
    if (!isSeen(this.panel)) return;
    this.next = place;
    this.ask();
  }

  ask() {
    if (this.isAsking || !this.next) return;
    this.isAsking = true;
    this.send("probe", this.next);
    this.next = null;
  }

  /** Forget a question that a lost connection took with it. */
  forget() {
    this.isAsking = false;
  }

  show(probed) {
    this.isAsking = false;
    this.ask();
    if (probed === null) return;
    const bytes = probed.shown.map((part) => Math.round(255 * part));
    this.swatch.style.background = `rgb(${bytes.join(" ")})`;
    const rows = [
      ["Pixel", `${probed.x}, ${probed.y}`],
      ["On the screen", probed.shown.map((part) => part.toFixed(3)).join(", ")],
      ["8 bit", bytes.join(", ")],
      ["Before the view", probed.rendered.map(short).join(", ")],
    ];
    if (probed.aov !== "color") probed.channels.forEach((name, index) => rows.push([name, short(probed.values[index])]));
    if (probed.position) rows.push(["P", probed.position.map(short).join(", ")]);
    if (probed.path) rows.push(["Prim", probed.path], ["Face or splat", short(probed.element)]);
    this.list.replaceChildren(...rows.flatMap(([name, value]) => [
      made("dt", { textContent: name }), made("dd", { textContent: value }),
    ]));
  }
}

export class Histogram {
  /** @param {(type: string, members?: object) => void} send */
  constructor(panel, canvas, send) {
    Object.assign(this, { panel, canvas, send });
    panel.addEventListener("toggle", () => this.refresh());
  }

  refresh() {
    if (isSeen(this.panel)) this.send("count");
  }

  /** Draw the counts; the first and the last may be clipped, so that the others can be seen. */
  show(counts) {
    const { width, height } = this.canvas;
    const context = this.canvas.getContext("2d");
    context.clearRect(0, 0, width, height);
    if (counts === null) return;
    const channels = [counts.red, counts.green, counts.blue];
    const inner = channels.flatMap((each) => [...each.slice(1, -1)]).sort((a, b) => a - b);
    const most = Math.max(inner[Math.floor(0.995 * inner.length)], 1);
    context.globalCompositeOperation = "lighter";
    channels.forEach((each, index) => {
      context.fillStyle = COLORS[index];
      context.globalAlpha = 0.7;
      each.forEach((count, bin) => {
        const tall = Math.min(count / most, 1) * height;
        context.fillRect((bin * width) / each.length, height - tall, width / each.length, tall);
      });
    });
    context.globalAlpha = 1;
    this.canvas.dataset.pixels = counts.pixels;
  }
}

/** Whether a panel is open, and the panels are shown. */
function isSeen(panel) {
  return panel.open && panel.offsetParent !== null;
}
