// The picture, and navigation by mouse, trackpad, touch and keys.

const MOST_RATIO = 2; // most device pixels per CSS pixel that are worth their time
const MOST_PIXELS = 2560 * 1600;
const CLICK = 4; // CSS pixels that the pointer may move during a click
const TAP = 10; // the same of a finger
const TWICE = [350, 32]; // ms and CSS pixels between the taps of a double tap
const REST = 180; // ms after the last wheel event
const FAST = 4; // speed factor with Shift
const FLIGHT = {
  KeyW: ["forward", 1], KeyS: ["forward", -1], KeyD: ["right", 1], KeyA: ["right", -1],
  KeyE: ["up", 1], KeyQ: ["up", -1],
};

export class Viewport {
  /** @param {(type: string, members?: object) => void} send */
  constructor(element, canvas, send) {
    this.element = element;
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.send = send;
    this.pointers = new Map();
    this.held = new Set();
    this.pending = new Map();
    this.size = this.measured();
    this.times = [];
    this.shown = null; // width and height of the shown picture's viewport, which is the driver's
    /** Called when the picture's place in the element may have changed. */
    this.placed = () => {};
    /** Called with the place of a pointer over the picture, and of a tap. */
    this.hovered = () => {};
    new ResizeObserver(() => this.resized()).observe(element);
    this.listen();
  }

  // --- pictures ---

  async show(header, image) {
    // unconverted: its values are already display values
    const bitmap = await createImageBitmap(image, { colorSpaceConversion: "none" });
    if (this.canvas.width !== header.width) this.canvas.width = header.width;
    if (this.canvas.height !== header.height) this.canvas.height = header.height;
    this.context.drawImage(bitmap, 0, 0);
    bitmap.close();
    this.canvas.dataset.number = header.number;
    this.canvas.dataset.final = header.is_final;
    this.shown = header.viewport;
    this.placed();
    const now = performance.now();
    this.times = [...this.times.filter((time) => now - time < 1000), now];
  }

  /** Pictures per second during a move; 0 at rest. */
  get rate() {
    const [first, last] = [this.times[0], this.times.at(-1)];
    return this.times.length > 2 ? (1000 * (this.times.length - 1)) / (last - first) : 0;
  }

  measured() {
    const { clientWidth, clientHeight } = this.element;
    const wanted = Math.min(window.devicePixelRatio || 1, MOST_RATIO);
    const most = Math.sqrt(MOST_PIXELS / Math.max(clientWidth * clientHeight, 1));
    const ratio = Math.min(wanted, most);
    return {
      width: Math.min(Math.max(Math.round(clientWidth * ratio), 16), 4096),
      height: Math.min(Math.max(Math.round(clientHeight * ratio), 16), 4096),
    };
  }

  resized() {
    this.placed();
    const size = this.measured();
    if (size.width === this.size.width && size.height === this.size.height) return;
    this.size = size;
    this.send("resize", size);
  }

  // --- moves: at most one message of a kind per screen frame ---

  move(type, members) {
    if (this.pending.size === 0) requestAnimationFrame(() => this.flush());
    const sum = this.pending.get(type) ?? {};
    for (const [name, value] of Object.entries(members)) {
      sum[name] = name === "factor" ? (sum[name] ?? 1) * value : (sum[name] ?? 0) + value;
    }
    this.pending.set(type, sum);
  }

  flush() {
    for (const [type, members] of this.pending) this.send(type, members);
    this.pending.clear();
  }

  rest() {
    this.flush();
    this.send("end_move");
  }

  drag(type, dx, dy) {
    const height = this.element.clientHeight;
    this.move(type, { right: dx / height, down: dy / height });
  }

  dolly(amount) {
    this.move("dolly", { factor: Math.min(Math.max(Math.exp(amount), 0.05), 20) });
  }

  /** The rectangle of the picture in the element, which it fills in one direction [CSS pixel]. */
  get content() {
    const { clientWidth, clientHeight } = this.element;
    const [width, height] = this.shown ?? [clientWidth, clientHeight];
    const factor = Math.min(clientWidth / width, clientHeight / height);
    return {
      left: (clientWidth - factor * width) / 2, top: (clientHeight - factor * height) / 2,
      width: factor * width, height: factor * height,
    };
  }

  /** Position of a pointer in the shown picture, in pixels of its viewport from the upper left;
   *  null beside it. */
  place(event) {
    if (!this.shown) return null;
    const box = this.element.getBoundingClientRect();
    const { left, top, width, height } = this.content;
    const [x, y] = [event.clientX - box.left - left, event.clientY - box.top - top];
    if (x < -CLICK || y < -CLICK || x > width + CLICK || y > height + CLICK) return null;
    const clamp = (part, size) => Math.min(Math.max(part, 0), 1 - 1e-6) * size;
    return { x: clamp(x / width, this.shown[0]), y: clamp(y / height, this.shown[1]) };
  }

  pick(event, members) {
    const place = this.place(event);
    if (place) this.send("pick", { ...place, ...members });
  }

  hover(event) {
    const place = this.place(event);
    if (place) this.hovered(place);
  }

  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => this.pressed(event));
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    canvas.addEventListener("pointerup", (event) => this.released(event));
    canvas.addEventListener("pointercancel", (event) => this.released(event));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", (event) => {
      if (!this.isTouch) this.pick(event, { is_target: true });
    });
    canvas.addEventListener("wheel", (event) => this.wheeled(event), { passive: false });
    canvas.addEventListener("keydown", (event) => this.keyed(event));
    canvas.addEventListener("keyup", (event) => this.letGo(event.code));
    canvas.addEventListener("blur", () => [...this.held].forEach((code) => this.letGo(code)));
  }

  pressed(event) {
    event.preventDefault();
    this.canvas.focus({ preventScroll: true });
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.pointers.size > 1) {
      this.hasMoved = true; // two fingers are no click
      return;
    }
    this.start = { x: event.clientX, y: event.clientY };
    this.hasMoved = false;
    this.isTouch = event.pointerType === "touch";
    this.way = wayOf(event);
  }

  moved(event) {
    const last = this.pointers.get(event.pointerId);
    if (!last) {
      this.hover(event);
      return;
    }
    if (this.pointers.size === 2) {
      this.pinched(event, last);
    } else if (this.pointers.size === 1) {
      const far = Math.hypot(event.clientX - this.start.x, event.clientY - this.start.y);
      if (!this.hasMoved && far < (this.isTouch ? TAP : CLICK)) return;
      this.hasMoved = true;
      const [dx, dy] = [event.clientX - last.x, event.clientY - last.y];
      if (this.way === "dolly") this.dolly((dx + dy) / -250);
      else this.drag(this.way, dx, dy);
    }
    last.x = event.clientX;
    last.y = event.clientY;
  }

  pinched(event, last) {
    const other = [...this.pointers.values()].find((each) => each !== last);
    const before = Math.hypot(last.x - other.x, last.y - other.y);
    const after = Math.hypot(event.clientX - other.x, event.clientY - other.y);
    if (before > 8 && after > 8) this.dolly(Math.log(before / after));
    this.drag("pan", (event.clientX - last.x) / 2, (event.clientY - last.y) / 2);
  }

  released(event) {
    if (!this.pointers.delete(event.pointerId) || this.pointers.size) return;
    if (this.hasMoved) this.rest();
    else if (event.type === "pointerup" && event.button === 0 && !event.altKey) {
      if (this.isTouch) this.hover(event);
      this.pick(event, { is_framed: this.isTouch && this.isSecondTap(event) });
    }
  }

  /** Whether a tap is the second of a double tap. */
  isSecondTap(event) {
    const [time, distance] = TWICE;
    const last = this.tapped;
    const isSecond = last !== undefined && event.timeStamp - last.time < time
      && Math.hypot(event.clientX - last.x, event.clientY - last.y) < distance;
    this.tapped = isSecond ? undefined : { time: event.timeStamp, x: event.clientX, y: event.clientY };
    return isSecond;
  }

  wheeled(event) {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    const pinch = event.ctrlKey ? 8 : 1; // a trackpad's pinch arrives as Ctrl and wheel
    this.dolly(0.0012 * lines * pinch * event.deltaY);
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.rest(), REST);
  }

  keyed(event) {
    if (!(event.code in FLIGHT) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    if (event.repeat) return;
    this.held.add(event.code);
    this.fly(event.shiftKey ? FAST : 1);
  }

  letGo(code) {
    if (!this.held.delete(code)) return;
    if (this.held.size) this.fly(1);
    else this.rest();
  }

  /** Set the flight direction; the server flies until the next message. */
  fly(speed) {
    const way = { right: 0, up: 0, forward: 0 };
    for (const code of this.held) way[FLIGHT[code][0]] += FLIGHT[code][1] * speed;
    this.send("fly", way);
  }
}

/** Return the action of a drag: usdview's with Alt, and one suited to laptops without. */
function wayOf(event) {
  if (event.button === 1 || event.shiftKey) return "pan";
  if (event.button === 2) return event.altKey ? "dolly" : "look_around";
  return "orbit";
}
