// The likeness of two shapes in words.

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
 * Such as "Same part, 1.5 times as large".
 * @param {Scores} scores
 */
export function inWords({ likeness, scale }) {
  const size = likeness === "scaled" && scale ? `, ${Number(scale.toPrecision(3))} times as large` : "";
  return WORDS[likeness] + size;
}
