// The measures of a shape in words.

/** @import { Facts, Shape } from "./types.js" */

/** @param {number} value */
export const rounded = (value) => String(Number(value.toPrecision(4)));

/** @param {number[]} box @param {string} unit */
const sides = (box, unit) => [box.map(rounded).join(" × "), unit].filter(Boolean).join(" ");

/**
 * The sides of the least box, the largest first, such as "60 × 50 × 40 mm".
 * @param {{ facts: Facts, unit: string }} shape
 */
export const sizeOf = ({ facts, unit }) => sides(facts.bounding_box, unit);

/** The size in one line, with the sides along the axes of the file. @param {{ facts: Facts, unit: string }} shape */
export const sizes = (shape) => `${sizeOf(shape)} (x, y, z: ${sides(shape.facts.file_box, "")})`;

/**
 * Names and values of the measures of a shape, and their unit.
 * @param {Shape} shape
 * @param {number | null} ratio Its size over that of the query.
 * @returns {[string, string][]}
 */
export const measures = ({ facts, unit }, ratio) => [
  ...(ratio === null ? [] : [/** @type {[string, string]} */ (["size ratio", rounded(ratio)])]),
  ["unit", unit || "not stated"],
  ["least box", sides(facts.bounding_box, unit)],
  ["along x, y, z", sides(facts.file_box, unit)],
  ["area", rounded(facts.area) + (unit && ` ${unit}²`)],
  ["volume", facts.closed ? rounded(facts.volume) + (unit && ` ${unit}³`) : "none, the surface is open"],
  ["vertices", facts.vertices.toLocaleString("en")],
  ["faces", facts.faces.toLocaleString("en")],
];
