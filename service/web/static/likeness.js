// The likeness of two shapes in one line.

/** @import { Scores } from "./types.js" */

/** @type {Record<string, string>} */
const WORDS = {
  same: "Same part",
  scaled: "Same part",
  mirrored: "Mirror image",
  variant: "Variant",
  pose: "Another pose",
  similar: "Similar",
  weak: "Weak",
};

/**
 * The likeness of a rigid copy, such as "Same part, 1.5 times as large".
 * @param {{ likeness: string, scale: number | null }} copy
 */
export const copyVerdict = ({ likeness, scale }) => WORDS[likeness] + (likeness === "same" ? "" : size(scale));

/**
 * Such as "Same part, 1.5 times as large", "Another pose, 0.996" or "Similar: 91 %".
 * @param {Scores} scores
 */
export function verdict(scores) {
  if (scores.likeness === "pose") return `${WORDS.pose}, ${digits(scores.cc)}`;
  const copy = !["similar", "weak"].includes(scores.likeness);
  return copy ? copyVerdict(scores) : `${WORDS[scores.likeness]}: ${percent(scores.combined)}`;
}

/** @param {number | null} scale Copies whose sizes differ by at most 3 % have one size. */
const size = (scale) => scale === null || Math.abs(Math.log(scale)) <= Math.log(1.03) ? ""
  : `, ${Number(scale.toPrecision(3))} times as large`;

/** @param {number} share */
function percent(share) {
  if (share < 0.01) return "under 1 %";
  return share > 0.99 ? "over 99 %" : `${Math.round(100 * share)} %`;
}

/**
 * A score with three digits; close to 1, with as many as tell it from 1.
 * @param {number} value
 */
export const digits = (value) => value < 0.9995 || value >= 1 ? value.toFixed(3)
  : value.toFixed(Math.min(6, Math.ceil(-Math.log10(1 - value))));
