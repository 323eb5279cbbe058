// The record of a shape in words.

/** @import { Mesh } from "./types.js" */

/** @param {number} value */
const rounded = (value) => String(Number(value.toPrecision(4)));

/** @param {number[]} box */
const sides = (box) => box.map(rounded).join(" × ");

/** @param {string} unit */
const named = (unit) => (unit ? ` ${unit}` : ", no unit");

/**
 * The sides of the least box, such as "60 × 50 × 40 mm"; with those along the axes of the file where they are others.
 * @param {Mesh} mesh
 */
export function sizes({ facts, unit }) {
  const least = sides(facts.bounding_box), along = sides(facts.file_box);
  const same = least === sides([...facts.file_box].sort((a, b) => b - a));
  return `${least}${named(unit)}${same ? "" : ` (x, y, z: ${along})`}`;
}

/** The text of a value of the metadata: text as it is, other values as JSON. @param {unknown} value */
export const textOf = (value) => (typeof value === "string" ? value : JSON.stringify(value));

const DAY = new Intl.DateTimeFormat("en", { dateStyle: "medium" });

/** The day of a time, such as "Jan 31, 2026". @param {string} time */
export const day = (time) => DAY.format(new Date(time));

const MOMENT = new Intl.DateTimeFormat("en", { dateStyle: "medium", timeStyle: "short" });

/** A time, such as "Jan 31, 2026, 4:05 PM". @param {string} time */
export const moment = (time) => MOMENT.format(new Date(time));

/**
 * Names and values of the measures of a mesh, and their unit.
 * @param {Mesh} mesh
 * @param {number | null} ratio Its size over that of the query.
 * @returns {[string, string][]}
 */
export const measures = ({ facts, unit }, ratio) => [
  ...(ratio === null ? [] : [/** @type {[string, string]} */ (["size ratio", rounded(ratio)])]),
  ["least box", sides(facts.bounding_box) + named(unit)],
  ["along x, y, z", sides(facts.file_box) + named(unit)],
  ["area", rounded(facts.area) + (unit && ` ${unit}²`)],
  ["volume", facts.closed ? rounded(facts.volume) + (unit && ` ${unit}³`) : "none, the surface is open"],
  ["vertices", facts.vertices.toLocaleString("en")],
  ["faces", facts.faces.toLocaleString("en")],
];
