// The keys of the page and its gestures: what the page does on a key, and what the help says of it.

import { made } from "./knobs.js";

export const GESTURES = [
  ["Drag; one finger", "orbit"],
  ["Shift-drag, middle drag; two fingers", "pan"],
  ["Wheel, Alt and right drag; pinch", "go nearer or away"],
  ["Right drag", "look around"],
  ["Hold W A S D Q E", "fly; Shift is faster"],
  ["Click; tap", "pick a splat or a mesh, and select its prim"],
  ["Double click", "orbit the point under the pointer"],
  ["Double tap", "frame what is there, or everything"],
  ["Drag the wipe", "move the line of the comparison"],
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
  const rows = [...GESTURES, ...actions.map((each) => [each.keys, each.text])];
  help.querySelector("tbody").replaceChildren(...rows.map(([keys, text]) => {
    const row = made("tr");
    row.append(made("th", { textContent: keys, scope: "row" }), made("td", { textContent: text }));
    return row;
  }));
}
