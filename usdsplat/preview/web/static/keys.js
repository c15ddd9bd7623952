// The keys of the page and its gestures: what the page does on a key, and what the help says of it.

import { made } from "./knobs.js";

const TOUCH = matchMedia("(pointer: coarse) and (hover: none)"); // no mouse, and mostly no keys

/** With a mouse, with fingers, and what it does; "" for a way that does not exist. */
const GESTURES = [
  ["Drag", "One finger", "orbit"],
  ["Shift-drag, middle drag", "Two fingers", "pan"],
  ["Wheel, Alt and right drag", "Pinch", "go nearer or away"],
  ["Right drag", "", "look around"],
  ["Hold W A S D Q E", "", "fly; Shift is faster"],
  ["Click", "Tap", "pick a splat or a mesh, and select its prim"],
  ["Double click", "", "orbit the point under the pointer"],
  ["", "Double tap", "frame what is there, or everything"],
  ["Drag the wipe", "Drag the wipe", "move the line of the comparison"],
];

/**
 * Call actions on keys, and list them in the help.
 * @param {{keys: string, codes: string[], text: string, isMenu?: boolean, isGlobal?: boolean,
 *          run: (event: KeyboardEvent) => void}[]} actions With Ctrl or Command if `isMenu`; also
 *   on a focused control if `isGlobal`.
 */
export function listen(actions, help) {
  document.addEventListener("keydown", (event) => {
    const isMenu = event.ctrlKey || event.metaKey;
    const isControl = event.target.matches("button, select, input, summary"); // they handle keys themselves
    const action = actions.find((each) => each.codes.includes(event.code)
      && (each.shift === undefined || each.shift === event.shiftKey)
      && Boolean(each.isMenu) === isMenu && !event.altKey && (each.isMenu || each.isGlobal || !isControl));
    if (!action || help.open) return;
    event.preventDefault();
    action.run(event);
  });
  const gestures = GESTURES.map(([mouse, fingers, text]) => [TOUCH.matches ? fingers : mouse, text]);
  const keys = TOUCH.matches ? [] : actions.map((each) => [each.keys, each.text]);
  const rows = [...gestures.filter(([way]) => way), ...keys];
  help.querySelector("tbody").replaceChildren(...rows.map(([keys, text]) => {
    const row = made("tr");
    row.append(made("th", { textContent: keys, scope: "row" }), made("td", { textContent: text }));
    return row;
  }));
}
