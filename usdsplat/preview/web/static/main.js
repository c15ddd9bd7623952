// Assembles the page: passes server messages to the controls, and user actions to the server.

import { Connection } from "./connection.js";
import { Knobs, made, short } from "./knobs.js";
import { Timeline } from "./timeline.js";
import { Viewport } from "./viewport.js";

const at = (id) => document.getElementById(id);
const FREE = "free camera";
const ALL = "frame everything";

const SMALL = matchMedia("(max-width: 760px)"); // as in style.css

const send = (type, members) => connection.send(type, members);
showPanels(!SMALL.matches); // before the viewport is measured
const viewport = new Viewport(at("viewport"), at("picture"), send);
const timeline = new Timeline(send);
const display = new Knobs(at("display"), (name, value) => send("set_display", { name, value }));
const render = new Knobs(at("render"), (name, value) => send("set_setting", { name, value }));
const parameters = new Map();
let frames = null;

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
    at("simulation-panel").hidden = !has_simulation;
    at("picked").replaceChildren(made("p", { className: "quiet", textContent: "Click a splat or a mesh." }));
  },
  state(state) {
    at("camera").value = state.is_free ? FREE : state.camera ?? "";
    at("aov").value = state.aov;
    timeline.show(state);
    timeline.mark(frames);
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
    at("busy").hidden = !what;
    at("busy").textContent = what;
  },
  said(sentence) {
    at("busy").hidden = false;
    at("busy").textContent = sentence;
    setTimeout(() => { if (at("busy").textContent === sentence) at("busy").hidden = true; }, 3000);
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
  },
  state(isOpen) {
    at("connection").hidden = isOpen;
    at("connection").textContent = "Connection lost. Trying again…";
    document.body.dataset.connected = isOpen;
  },
});

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
  const quality = header.is_final ? "full" : header.is_sharp ? "sharp" : header.scale > 1 ? `1 : ${short(header.scale)}` : "coarse";
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

function showPicked(picked) {
  if (picked === null) {
    at("picked").replaceChildren(made("p", { className: "quiet", textContent: "Nothing is there." }));
    return;
  }
  const list = made("dl");
  for (const [name, value] of flat(picked)) {
    list.append(made("dt", { textContent: name.replaceAll("_", " ") }), made("dd", { textContent: value }));
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

document.addEventListener("keydown", (event) => {
  const isMenu = event.ctrlKey || event.metaKey;
  const isControl = event.target.matches("button, select, input, summary");
  if (isMenu && event.code === "KeyZ") send(event.shiftKey ? "redo" : "undo");
  else if (isMenu || event.altKey) return;
  else if (event.code === "KeyF") send("frame", { everything: event.shiftKey });
  else if (isControl) return; // controls handle these keys themselves
  else if (event.code === "Space") timeline.toggle();
  else if (event.code === "ArrowLeft") send("advance", { frames: -1 });
  else if (event.code === "ArrowRight") send("advance", { frames: 1 });
  else if (event.code === "Home") send("set_time", { time: timeline.state.start });
  else if (event.code === "End") send("set_time", { time: timeline.state.end });
  else return;
  event.preventDefault();
});
