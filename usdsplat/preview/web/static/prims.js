// The tree of prims: read as far as it is open, with a search and visibility.

import { made } from "./knobs.js";

const PAUSE = 200; // ms after the last key before a search

export class Prims {
  /** @param {(type: string, members?: object) => void} send */
  constructor(tree, field, send) {
    this.tree = tree;
    this.field = field;
    this.send = send;
    this.rows = new Map(); // path -> {element, list, isOpen}
    this.selected = new Set();
    this.wanted = new Map(); // what to ask for, one after the other
    this.isAsking = false;
    field.addEventListener("input", () => {
      clearTimeout(this.waiting);
      this.waiting = setTimeout(() => this.search(), PAUSE);
    });
    field.addEventListener("keydown", (event) => event.stopPropagation());
  }

  /** Forget everything, and read the roots. */
  reset() {
    this.rows.clear();
    this.rows.set("/", { list: this.tree, isOpen: true });
    this.tree.replaceChildren();
    this.field.value = "";
    this.wanted.clear();
    this.ask("/");
  }

  /** Forget questions that a lost connection took with it. */
  forget() {
    this.wanted.clear();
    this.isAsking = false;
  }

  ask(path, first = 0) {
    this.wanted.set(`${path} ${first}`, { path, first });
    this.askNext();
  }

  askNext() {
    const [key, question] = this.wanted.entries().next().value ?? [];
    if (this.isAsking || !question) return;
    this.wanted.delete(key);
    if (!this.rows.get(question.path)?.isOpen) {
      this.askNext();
      return;
    }
    this.isAsking = true;
    this.send("list_prims", question);
  }

  /** Read again what is open. */
  refresh() {
    if (this.field.value.trim()) return;
    for (const [path, { isOpen }] of this.rows) if (isOpen) this.ask(path);
  }

  search() {
    const text = this.field.value.trim();
    if (text) this.send("search_prims", { text });
    else this.reset();
  }

  show(answer) {
    this.isAsking = false;
    if (answer.rows) this.list(answer); // null: there is no such prim, or too much was asked
    this.askNext();
  }

  list({ path, first, rows, has_more: hasMore }) {
    const parent = this.rows.get(path);
    if (!parent?.isOpen || this.field.value.trim()) return;
    const before = [...parent.list.children].filter((each) => each.className !== "more-prims");
    const last = first + rows.length;
    const rest = hasMore ? before.slice(last) : []; // what "More…" has loaded stays, and is asked for
    parent.list.replaceChildren(...before.slice(0, first), ...rows.map((row) => this.item(row)), ...rest);
    if (hasMore) {
      const count = parent.list.children.length;
      const more = made("button", { type: "button", textContent: "More…" });
      more.addEventListener("click", () => this.ask(path, count));
      const item = made("li", { className: "more-prims" });
      item.append(more);
      parent.list.append(item);
    }
    for (const [each, { element }] of this.rows) if (element && !element.isConnected) this.rows.delete(each);
    if (rest.length) this.ask(path, last);
    this.mark();
    this.reveal();
  }

  showFound({ text, paths }) {
    if (text !== this.field.value.trim()) return;
    this.rows.clear();
    this.tree.replaceChildren(...paths.map((path) => {
      const item = made("li");
      item.append(this.nameOf(path, path));
      this.rows.set(path, { element: item });
      return item;
    }));
    if (!paths.length) this.tree.append(made("li", { className: "quiet", textContent: "Nothing matches." }));
    this.mark();
  }

  select(paths) {
    const isNew = (path) => !this.selected.has(path);
    this.hidden = new Set([...(this.hidden ?? []), ...paths.filter(isNew)].filter((path) => paths.includes(path)));
    this.selected = new Set(paths);
    this.mark();
    this.reveal();
  }

  /** Open the ancestors of what was selected elsewhere, as far as they are read, and scroll to it. */
  reveal() {
    if (this.field.value.trim()) return;
    for (const path of this.hidden ?? []) {
      const found = this.rows.get(path);
      if (found) {
        this.hidden.delete(path);
        found.element?.scrollIntoView({ block: "nearest" });
        continue;
      }
      const parts = path.split("/").slice(1, -1);
      const above = parts.map((_, index) => `/${parts.slice(0, index + 1).join("/")}`);
      const shut = above.find((each) => !this.rows.get(each)?.isOpen);
      const row = this.rows.get(shut);
      if (row) this.fold(shut, row.element.querySelector(".fold"));
    }
  }

  mark() {
    for (const [path, { element }] of this.rows) {
      element?.querySelector(".prim-name").setAttribute("aria-pressed", this.selected.has(path));
    }
  }

  item(row) {
    const before = this.rows.get(row.path);
    const list = before?.list ?? made("ul");
    const isOpen = Boolean(before?.isOpen && row.has_children);
    const item = made("li", { className: row.is_visible && row.is_active ? "" : "unseen" });
    const line = made("div", { className: "prim" });
    const fold = made("button", { type: "button", className: "fold", textContent: isOpen ? "▾" : "▸" });
    fold.ariaLabel = `Children of ${row.name}`;
    fold.ariaExpanded = String(isOpen);
    fold.style.visibility = row.has_children ? "" : "hidden";
    fold.addEventListener("click", () => this.fold(row.path, fold));
    const eye = made("button", { type: "button", className: "eye", textContent: row.is_visible ? "●" : "○" });
    eye.ariaLabel = `${row.is_visible ? "Hide" : "Show"} ${row.name}`;
    eye.title = row.is_visible ? "Hide" : "Show";
    eye.hidden = !row.can_hide;
    eye.addEventListener("click", () => {
      this.send("set_visible", { path: row.path, is_visible: !row.is_visible });
    });
    line.append(fold, this.nameOf(row.path, row.name), made("span", { className: "quiet", textContent: row.type }), eye);
    list.hidden = !isOpen;
    item.append(line, list);
    this.rows.set(row.path, { element: line, list, isOpen });
    return item;
  }

  nameOf(path, text) {
    const name = made("button", { type: "button", className: "prim-name", textContent: text, title: path });
    name.addEventListener("click", () => {
      this.send("select", { path: this.selected.has(path) ? null : path });
    });
    return name;
  }

  fold(path, button) {
    const row = this.rows.get(path);
    row.isOpen = !row.isOpen;
    row.list.hidden = !row.isOpen;
    button.textContent = row.isOpen ? "▾" : "▸";
    button.ariaExpanded = String(row.isOpen);
    if (row.isOpen) this.ask(path);
  }
}
