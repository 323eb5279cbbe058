// A card: a shape in 3D with its name and its likeness in one line; its scores are behind "Details".

import { make } from "./dom.js";

/** @import { Scores } from "./types.js" */

/** @type {Record<string, string>} */
const WORDS = {
  same: "Same part",
  scaled: "Same part",
  mirrored: "Mirror image",
  variant: "Variant",
  part_of: "Part of",
  pose: "Another pose",
  similar: "Similar",
  weak: "Weak",
};

/**
 * The likeness of a rigid copy, such as "Same part, 1.5 times as large".
 * @param {{ likeness: string, scale: number | null }} copy
 */
export const copyVerdict = ({ likeness, scale }) => WORDS[likeness] + size(scale);

/**
 * Such as "Same part, 1.5 times as large", "Another pose" or "Similar: 91 %".
 * @param {Scores} scores
 */
export function verdict(scores) {
  if (scores.instances) return scores.instances.text;
  const copy = !["similar", "weak"].includes(scores.likeness);
  return copy ? copyVerdict(scores) : `${WORDS[scores.likeness]}: ${percent(scores.combined)}`;
}

/** @param {number} scale The size of a copy is told if it differs by more than 0.1 %. */
export const sizeIsTold = (scale) => Math.max(scale, 1 / scale) > 1.001;

/** @param {number | null} scale */
const size = (scale) => scale !== null && sizeIsTold(scale)
  ? `, ${Number(scale.toPrecision(4))} times as large` : "";

/** @param {number} share */
function percent(share) {
  if (share < 0.01) return "under 1 %";
  return share > 0.99 ? "over 99 %" : `${Math.round(100 * share)} %`;
}

/**
 * A score with three digits; close to 1, with as many as tell it from 1.
 * @param {number} value
 */
const digits = (value) => value < 0.9995 || value >= 1 ? value.toFixed(3)
  : value.toFixed(Math.min(6, Math.ceil(-Math.log10(1 - value))));

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
  const heading = make("h3", {});
  /** @param {string} text Of the card, from now on. */
  const retitle = (text) => {
    heading.textContent = text;
    canvas.setAttribute("aria-label", `${text} in 3D. The arrow keys rotate it, plus and minus zoom.`);
  };
  retitle(title);
  const parts = [canvas, heading, ...lines.map((line) => make("p", {}, line)), ...more];
  if (scores) {
    const change = make("p", { className: "change" }, scores.difference?.text ?? "");
    parts.splice(2, 0, make("p", { className: "likeness" }, verdict(scores)), change);
  }
  return { canvas, item: make("li", {}, ...parts), retitle };
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
