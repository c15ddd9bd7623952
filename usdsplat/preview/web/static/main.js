// Assembles the page: passes server messages to the controls, and user actions to the server.

import { Compare } from "./compare.js";
import { Connection } from "./connection.js";
import { listen } from "./keys.js";
import { Knobs, made, short } from "./knobs.js";
import { Prims } from "./prims.js";
import { Histogram, Probe } from "./probe.js";
import { Timeline } from "./timeline.js";
import { Viewport } from "./viewport.js";

const at = (id) => document.getElementById(id);
const FREE = "free camera";
const ALL = "frame everything";

const SMALL = matchMedia("(max-width: 760px), (max-height: 480px)"); // as in style.css

const send = (type, members) => connection.send(type, members);
showPanels(!SMALL.matches); // before the viewport is measured
const viewport = new Viewport(at("viewport"), at("picture"), send);
const timeline = new Timeline(send);
const compare = new Compare(viewport, send);
const prims = new Prims(at("prims"), at("prims-search"), send);
const probe = new Probe(at("probe-panel"), at("swatch"), at("probed"), send);
const histogram = new Histogram(at("histogram-panel"), at("histogram"), send);
viewport.hovered = (place) => probe.follow(place);
const display = new Knobs(at("display"), (name, value) => send("set_display", { name, value }));
const render = new Knobs(at("render"), (name, value) => send("set_setting", { name, value }));
const parameters = new Map();
let frames = null;
let openedName = null;
let bookmarks = [];

const heard = {
  opened({ name, cameras, aovs, has_simulation }) {
    document.title = `${name} – usdsplat`;
    at("name").textContent = name;
    at("name").title = name;
    at("camera").replaceChildren(
      new Option(ALL, ""), ...cameras.map((path) => new Option(path, path)), new Option(FREE, FREE),
    );
    at("camera").lastChild.disabled = true; // selected by moving the camera
    at("aov").replaceChildren(...aovs.map((aov) => {
      const option = new Option(aov.name, aov.name);
      option.title = aov.meaning;
      return option;
    }));
    compare.offer(aovs);
    if (name !== openedName) prims.reset(); // a new structure alone comes as stage_changed
    openedName = name;
    at("simulation-panel").hidden = !has_simulation;
    at("picked").replaceChildren(made("p", { className: "quiet", textContent: "Click a splat or a mesh." }));
  },
  state(state) {
    at("camera").value = state.is_free ? FREE : state.camera ?? "";
    at("aov").value = state.aov;
    timeline.show(state);
    timeline.mark(frames);
    compare.show(state);
    prims.select(state.selected);
    showBookmarks(state.bookmarks);
  },
  prims: (rows) => prims.show(rows),
  found: (found) => prims.showFound(found),
  probed: (probed) => probe.show(probed),
  histogram: (counts) => histogram.show(counts),
  stage_changed: () => prims.refresh(),
  recording(progress) {
    at("record").textContent = progress ? `Stop (${progress})` : "Record";
    at("record").setAttribute("aria-pressed", Boolean(progress));
  },
  settings(content) {
    display.show(content.display);
    render.show(content.render);
  },
  parameters: showParameters,
  simulation(status) {
    const runs = ["beginning", "running", "recording"].includes(status.state);
    at("simulation-panel").hidden = status.state === "none" && at("parameters").children.length === 0;
    at("simulation-run").disabled = runs;
    at("simulation-pause").disabled = !runs;
    at("simulation-step").disabled = runs;
    at("simulation-status").textContent = told(status);
    at("simulation-status").dataset.state = status.state;
    frames = status.frames;
    timeline.mark(frames);
  },
  picked: showPicked,
  problem(sentence) {
    at("problem").hidden = false;
    at("problem").firstElementChild.textContent = sentence;
  },
  busy(what) {
    at("busy").dataset.busy = what;
    at("busy").hidden = !what;
    at("busy").textContent = what;
  },
  said(sentence) {
    at("busy").hidden = false;
    at("busy").textContent = sentence;
    setTimeout(() => { if (at("busy").textContent === sentence) heard.busy(at("busy").dataset.busy ?? ""); }, 3000);
  },
  seats: showSeats,
  watching() { // answers an action that only the driving page may do
    at("seats").classList.add("nudged");
  },
};

const connection = new Connection({
  open: () => viewport.size,
  message: (type, content) => heard[type](content),
  async frame(header, image) {
    await viewport.show(header, image);
    showHud(header);
    if (header.is_final) histogram.refresh();
  },
  file(name, blob) {
    const link = made("a", { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
  },
  state(isOpen, isFull = false) {
    at("connection").hidden = isOpen;
    at("connection").textContent = isFull
      ? "As many pages as can watch are open. Trying until one is closed…"
      : "Connection lost. Trying again…";
    document.body.dataset.connected = isOpen;
    probe.forget();
    prims.forget();
    openedName = null;
  },
});

function showBookmarks(names) {
  if (names.join("\n") === bookmarks.join("\n")) return;
  bookmarks = names;
  at("bookmarks").replaceChildren(...names.map((name) => {
    const item = made("li");
    const restore = made("button", { type: "button", textContent: name, className: "grows" });
    restore.addEventListener("click", () => send("restore_bookmark", { name }));
    const remove = made("button", { type: "button", textContent: "×", ariaLabel: `Remove ${name}` });
    remove.addEventListener("click", () => send("remove_bookmark", { name }));
    item.append(restore, remove);
    return item;
  }));
}

function showSeats({ you, driver, pages }) {
  const drives = you === driver;
  const others = pages - 1;
  document.body.dataset.drives = drives;
  at("seats").hidden = others === 0;
  at("seats").firstElementChild.textContent = drives
    ? `You drive as viewer ${you}; ${others === 1 ? "another viewer watches" : `${others} others watch`}.`
    : `You watch as viewer ${you}; viewer ${driver} drives.`;
  at("take-control").hidden = drives;
  for (const element of document.querySelectorAll("[data-driver]")) element.inert = !drives;
}

function told(status) {
  const parts = [status.state];
  if (status.frame !== null) parts.push(`frame ${short(status.frame)}${status.end === null ? "" : ` of ${short(status.end)}`}`);
  if (status.splats) parts.push(`${status.splats.toLocaleString("en")} splats`);
  if (status.seconds) parts.push(`${Math.round(1000 * status.seconds)} ms a frame`);
  return parts.join(" · ") + (status.message ? `. ${status.message}` : "");
}

function showHud(header) {
  const count = (number) => number.toLocaleString("en");
  const { total, ...stages } = header.milliseconds;
  const reading = header.missing ? ` · reading ${count(header.missing)} nodes` : "";
  at("counts").textContent = `${count(header.splats)} of ${count(header.total)} splats${reading}`;
  const quality = header.lacks_light ? "last light" : header.is_final ? "full" : header.is_sharp ? "sharp" : header.scale > 1 ? `1 : ${short(header.scale)}` : "coarse";
  const size = ` · ${header.width} × ${header.height}, ${quality}`;
  const rate = viewport.rate ? ` · ${viewport.rate.toFixed(0)} fps` : "";
  at("speed").textContent = `${(total ?? 0).toFixed(0)} ms${rate}${size}`;
  at("speed").title = Object.entries(stages).map(([name, ms]) => `${name} ${ms} ms`).join("\n");
  at("machine").textContent = `${header.device} · ${count(Math.round(header.megabytes))} MB`;
  at("warnings").replaceChildren(...header.warnings.slice(0, 4).map((text) => made("li", { textContent: text })));
}

function showParameters(prims) {
  const paths = prims.map((prim) => prim.path);
  if (JSON.stringify(paths) !== JSON.stringify([...parameters.keys()])) {
    parameters.clear();
    at("parameters").replaceChildren(...prims.map((prim) => {
      const section = made("details", { open: prim.is_simulation });
      const body = made("div", { className: "body", id: `parameters-${paths.indexOf(prim.path)}` });
      section.append(made("summary", { textContent: `${prim.path} (${prim.type_name})` }), body);
      parameters.set(prim.path, new Knobs(body, (name, value, drag) => {
        send("set_parameter", { path: prim.path, name, value, drag });
      }));
      return section;
    }));
  }
  for (const prim of prims) parameters.get(prim.path).show(prim.editors);
}

/** Names of picked values, as in the window. */
const WORDS = {
  path: "Prim", kind: "Kind", instance: "Instance", position: "Seen at", id: "Id", center: "Centre",
  world_center: "In the world", scales: "Scales", rotation: "Rotation wxyz", opacity: "Opacity",
  color: "Colour", sh_degree: "SH degree",
};

function showPicked(picked) {
  if (at("panels").hidden) heard.said(picked === null ? "Nothing is there." : picked.path);
  if (picked === null) {
    at("picked").replaceChildren(made("p", { className: "quiet", textContent: "Nothing is there." }));
    return;
  }
  const list = made("dl");
  const own = picked.splat?.id === picked.element; // the id of a splat without one is its row
  for (const [name, value] of flat(picked)) {
    if ((name === "id" && own) || (name === "instance" && !picked.instance)) continue;
    const word = name === "element" ? (picked.splat ? "Splat" : "Face") : WORDS[name];
    list.append(made("dt", { textContent: word }), made("dd", { textContent: value }));
  }
  at("picked").replaceChildren(list);
}

/** Names and values of nested plain values, without nulls. */
function flat(object) {
  return Object.entries(object).flatMap(([name, value]) => {
    if (name === "type" || value === null || value === "") return []; // type: internal tag of the value
    if (Array.isArray(value)) return [[name, value.map(short).join(", ")]];
    return typeof value === "object" ? flat(value) : [[name, short(value)]];
  });
}

// --- buttons and keys ---

at("camera").addEventListener("change", () => send("use_camera", { path: at("camera").value || null }));
at("aov").addEventListener("change", () => send("set_aov", { name: at("aov").value }));
at("frame").addEventListener("click", () => send("frame"));
at("undo").addEventListener("click", () => send("undo"));
at("redo").addEventListener("click", () => send("redo"));
at("reload").addEventListener("click", () => send("reload"));
at("take-control").addEventListener("click", () => send("take_over", viewport.size));
at("problem").querySelector("button").addEventListener("click", () => { at("problem").hidden = true; });
at("seats").addEventListener("animationend", () => at("seats").classList.remove("nudged"));
for (const action of ["run", "pause", "step", "reset"]) {
  at(`simulation-${action}`).addEventListener("click", () => send("simulate", { action }));
}
function showPanels(isShown) {
  at("panels").hidden = !isShown;
  at("panels-shown").ariaExpanded = String(isShown);
  document.body.dataset.panels = isShown ? "shown" : "hidden";
}
at("panels-shown").addEventListener("click", () => showPanels(at("panels").hidden));


at("bookmark-add").addEventListener("submit", (event) => {
  event.preventDefault();
  send("add_bookmark", { name: at("bookmark-name").value.trim() });
  at("bookmark-name").value = "";
});
at("bookmark-name").addEventListener("keydown", (event) => event.stopPropagation());
at("screenshot").addEventListener("click", () => send("screenshot"));
at("record").addEventListener("click", () => {
  send(at("record").getAttribute("aria-pressed") === "true" ? "end_record" : "record");
});
at("help-shown").addEventListener("click", () => at("help").showModal());
at("help").querySelector("button").addEventListener("click", () => at("help").close());

function stepAov(by) {
  const options = at("aov").options;
  const next = (at("aov").selectedIndex + by + options.length) % options.length;
  send("set_aov", { name: options[next].value });
}

listen([
  { keys: "F, Shift-F", codes: ["KeyF"], text: "frame the selection, or everything", isGlobal: true, run: (event) => send("frame", { everything: event.shiftKey }) },
  { keys: "Space", codes: ["Space"], text: "play or stop", run: () => timeline.toggle() },
  { keys: "←", codes: ["ArrowLeft"], text: "one frame back", run: () => send("advance", { frames: -1 }) },
  { keys: "→", codes: ["ArrowRight"], text: "one frame on", run: () => send("advance", { frames: 1 }) },
  { keys: "Home", codes: ["Home"], text: "first frame", run: () => send("set_time", { time: timeline.state.start }) },
  { keys: "End", codes: ["End"], text: "last frame", run: () => send("set_time", { time: timeline.state.end }) },
  { keys: "[", codes: ["BracketLeft"], text: "previous AOV", run: () => stepAov(-1) },
  { keys: "]", codes: ["BracketRight"], text: "next AOV", run: () => stepAov(1) },
  { keys: "Shift-C", codes: ["KeyC"], shift: true, text: "compare A | B", run: () => compare.toggle() },
  { keys: "Ctrl-B", codes: ["KeyB"], text: "bookmark this view", isMenu: true, run: () => send("add_bookmark") },
  { keys: "Ctrl-Z", codes: ["KeyZ"], shift: false, text: "undo", isMenu: true, run: () => send("undo") },
  { keys: "Shift-Ctrl-Z", codes: ["KeyZ"], shift: true, text: "redo", isMenu: true, run: () => send("redo") },
  { keys: "F1, ?", codes: ["F1", "Slash"], text: "this table", run: () => at("help").showModal() },
], at("help"));
