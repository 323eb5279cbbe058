// A card: a shape in 3D with its name, its likeness and its scores.

import { make } from "./dom.js";
import { inWords } from "./likeness.js";

/** @import { Scores } from "./types.js" */

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
  if (scores) {
    const list = make("dl", { className: "scores" });
    for (const [name, value] of [["CC", scores.cc], ["SSD", scores.ssd], ["sim", scores.sim], ["combined", scores.combined]]) {
      list.append(make("dt", {}, String(name)), make("dd", {}, Number(value).toFixed(3)));
    }
    parts.splice(2, 0, make("p", { className: "likeness" }, inWords(scores)), list);
  }
  return { canvas, item: make("li", {}, ...parts) };
}
