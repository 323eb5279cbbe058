// A card: a shape in 3D with its name and its likeness; its scores are behind "Details".

import { make } from "./dom.js";
import { digits, verdict } from "./likeness.js";

/** @import { Scores } from "./types.js" */

/** @type {["cc" | "ssd" | "sim" | "combined", string][]} */
const SCORES = [["cc", "CC"], ["ssd", "SSD"], ["sim", "sim"], ["combined", "combined"]];

/**
 * @param {string} title
 * @param {string[]} lines
 * @param {Scores | null} scores
 * @param {...Node} more
 */
export function card(title, lines, scores, ...more) {
  const canvas = make("canvas", { tabIndex: 0 });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `${title} in 3D. The arrow keys rotate it, plus and minus zoom.`);
  const parts = [canvas, make("h3", {}, title), ...lines.map((line) => make("p", {}, line)), ...more];
  if (scores) parts.splice(2, 0, make("p", { className: "likeness" }, verdict(scores)));
  return { canvas, item: make("li", {}, ...parts) };
}

/**
 * The scores of two shapes and other numbers, in a disclosure.
 * @param {string} name Of the second shape.
 * @param {Scores} scores
 * @param {[string, string][]} [more] Names and values.
 */
export function details(name, scores, more = []) {
  const rows = [...SCORES.map(([key, title]) => [title, digits(scores[key])]), ...more];
  return make(
    "details", { className: "numbers" },
    make("summary", { ariaLabel: `Details of ${name}` }, "Details"),
    make("dl", { className: "scores" }, ...rows.flatMap(([term, value]) => [make("dt", {}, term), make("dd", {}, value)])),
  );
}
