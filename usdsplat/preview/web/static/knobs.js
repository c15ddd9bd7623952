// Controls built from the server's description of each knob: kind, value, limits, texts.

const EMPTY = "—";
const MOST_OPEN = 3; // groups that are not folded
let drags = 0;

/** A list of knobs under their headings, synchronised with the server. */
export class Knobs {
  /** @param {(name: string, value: any, drag: number) => void} turn
   *   Called for each change by the user; changes of one drag share a number, else it is 0. */
  constructor(element, turn) {
    this.element = element;
    this.turn = turn;
    this.rows = new Map();
    this.shape = "";
  }

  show(editors) {
    const shape = JSON.stringify(editors.map((each) => [each.name, each.kind, each.choices, each.group]));
    if (shape !== this.shape) this.build(editors);
    this.shape = shape;
    for (const editor of editors) this.rows.get(editor.name).show(editor);
  }

  build(editors) {
    this.rows.clear();
    const groups = new Map();
    const isLong = new Set(editors.map((each) => each.group)).size > MOST_OPEN;
    for (const editor of editors) {
      if (!groups.has(editor.group)) groups.set(editor.group, grouped(editor.group, !isLong || groups.size === 0));
      const row = new Row(editor, `${this.element.id}-${editor.name}`, this.turn);
      this.rows.set(editor.name, row);
      groups.get(editor.group).append(row.element);
    }
    this.element.replaceChildren(...groups.values());
  }
}

function grouped(title, isOpen) {
  const group = made("details", { className: "group", open: isOpen });
  group.append(made("summary", { textContent: title || "Other" }));
  return group;
}

/** One knob: its label, its control and a reset to its default. */
class Row {
  constructor(editor, id, turn) {
    this.turn = (value, drag = 0) => turn(editor.name, value, drag);
    this.control = controlOf(editor, id, this.turn);
    const label = made("label", { htmlFor: id, textContent: editor.label, title: editor.help });
    const value = made("span", { className: `value ${editor.kind}`, title: editor.help });
    value.append(...this.control.parts);
    if (editor.unit) value.append(made("span", { className: "unit", textContent: editor.unit }));
    this.reset = made("button", {
      type: "button", className: "reset", textContent: "↺",
      title: "Back to the default", ariaLabel: `${editor.label}: back to the default`,
    });
    this.reset.addEventListener("click", () => this.turn(editor.default));
    this.element = made("div", { className: "knob" });
    this.element.dataset.name = editor.name;
    this.element.append(label, value, this.reset);
  }

  show(editor) {
    this.element.classList.toggle("animated", editor.is_animated);
    const isDefault = JSON.stringify(editor.value) === JSON.stringify(editor.default);
    this.reset.hidden = isDefault || editor.is_read_only;
    for (const part of this.control.parts) part.disabled = editor.is_read_only;
    // keep a field that the user is typing in
    if (!this.control.parts.some((part) => part === document.activeElement && part.dataset.dirty)) {
      this.control.show(editor.value);
    }
  }
}

function controlOf(editor, id, turn) {
  const controls = { bool, int: number, float: number, choice, vector, color: vector };
  return (controls[editor.kind] ?? text)(editor, id, turn);
}

function bool(editor, id, turn) {
  const box = made("input", { type: "checkbox", id });
  box.addEventListener("change", () => turn(box.checked));
  return { parts: [box], show: (value) => { box.checked = value; } };
}

function choice(editor, id, turn) {
  const list = made("select", { id });
  list.append(...editor.choices.map((each) => new Option(each, each)));
  list.addEventListener("change", () => turn(list.value));
  return { parts: [list], show: (value) => { list.value = value; } };
}

function text(editor, id, turn) {
  const line = typed(made("input", { type: "text", id, spellcheck: false }), () => turn(line.value));
  return { parts: [line], show: (value) => { line.value = value ?? ""; } };
}

function number(editor, id, turn) {
  const isWhole = editor.kind === "int";
  const read = (input) => (input.value === "" && editor.none_label ? null : Number(input.value));
  const field = typed(limited(made("input", { type: "number", id }), editor, isWhole), () => turn(read(field)));
  const show = (value) => { field.value = value === null ? "" : short(value); };
  if (editor.none_label) { // an empty field has a meaning that a slider cannot show
    field.placeholder = editor.none_label;
    return { parts: [field], show };
  }
  const [low, high] = editor.soft_range;
  const slider = made("input", {
    type: "range", min: low, max: high, ariaLabel: editor.label,
    step: isWhole ? Math.max(1, editor.step) : editor.step,
  });
  let drag = 0;
  slider.addEventListener("pointerdown", () => { drag = ++drags; });
  slider.addEventListener("input", () => {
    field.value = slider.value;
    turn(Number(slider.value), drag);
  });
  slider.addEventListener("change", () => { drag = 0; });
  return { parts: [slider, field], show: (value) => { show(value); slider.value = value; } };
}

function vector(editor, id, turn) {
  const count = (editor.value ?? editor.default ?? [0, 0, 0]).length;
  const fields = Array.from({ length: count }, (_, index) => {
    const field = made("input", { type: "number", id: index ? `${id}-${index}` : id });
    field.ariaLabel = `${editor.label} ${index + 1}`;
    return typed(limited(field, editor, editor.is_whole), () => turn(fields.map((each) => Number(each.value))));
  });
  const show = (value) => fields.forEach((field, index) => {
    field.value = value === null ? "" : short(value[index]);
  });
  return { parts: fields, show };
}

/** A field whose value is sent on blur or Enter; Escape restores the old one. */
function typed(field, commit) {
  let before = "";
  field.addEventListener("focus", () => { before = field.value; });
  field.addEventListener("input", () => { field.dataset.dirty = "1"; });
  field.addEventListener("change", () => {
    delete field.dataset.dirty;
    if (field.checkValidity()) commit();
    else field.reportValidity();
  });
  field.addEventListener("keydown", (event) => {
    event.stopPropagation();
    if (event.key !== "Escape") return;
    field.value = before;
    delete field.dataset.dirty;
    field.blur();
  });
  return field;
}

function limited(field, editor, isWhole) {
  field.step = isWhole ? 1 : "any";
  if (editor.minimum !== null) field.min = editor.minimum;
  if (editor.maximum !== null) field.max = editor.maximum;
  return field;
}

/** The shortest text of a number that is exact at the displayed precision. */
export function short(value) {
  if (typeof value !== "number") return value === null || value === undefined ? EMPTY : String(value);
  return Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(6)));
}

export function made(tag, properties = {}) {
  return Object.assign(document.createElement(tag), properties);
}
