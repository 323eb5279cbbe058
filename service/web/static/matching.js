// Corresponding points of a query and of its results, and their colours.

import { placed } from "./glb.js";
import { coloursOfPoints } from "./paint.js";

/** @import { Model } from "./glb.js" */
/** @import { Colour } from "./paint.js" */
/** @import { Pair } from "./types.js" */

/**
 * Points of one shape that have a corresponding point.
 * @typedef {object} Ends
 * @property {number[]} samples Rows of the shape's embedding, ascending.
 * @property {number[]} vertices The file's vertex at each point.
 * @property {number[][]} points In the coordinates of the model.
 * @property {Colour[]} colours
 * @property {boolean[]} effective Whether one of its pairs is effective (counted by sim).
 */

/**
 * @param {Pair[]} pairs
 * @param {"first" | "second"} side
 * @param {Model} model
 * @returns {Ends}
 */
function endsOf(pairs, side, model) {
  /** @type {Map<number, Pair>} */
  const best = new Map();
  for (const pair of pairs) {
    const known = best.get(pair[side].sample);
    if (!known || (pair.effective && !known.effective)) best.set(pair[side].sample, pair);
  }
  const found = [...best.values()].sort((a, b) => a[side].sample - b[side].sample);
  return {
    samples: found.map((pair) => pair[side].sample),
    vertices: found.map((pair) => pair[side].vertex),
    points: found.map((pair) => placed(model, pair[side].position)),
    colours: [],
    effective: found.map((pair) => pair.effective),
  };
}

/**
 * The query's points with a corresponding point on any result, coloured by position.
 * @param {Pair[]} pairs Of all results.
 * @param {Model} model
 */
export function queryEnds(pairs, model) {
  const ends = endsOf(pairs, "first", model);
  ends.colours = coloursOfPoints(model, ends.points);
  return ends;
}

/**
 * A result's points, each in the colour of its corresponding point.
 * @param {Pair[]} pairs
 * @param {Model} model
 * @param {Ends} query
 */
export function resultEnds(pairs, model, query) {
  const ends = endsOf(pairs, "second", model);
  const colours = new Map(query.samples.map((sample, i) => [sample, query.colours[i]]));
  ends.colours = ends.samples.map((sample) => {
    const own = pairs.filter((pair) => pair.second.sample === sample);
    const partner = own.find((pair) => pair.effective) ?? own[0];
    return /** @type {Colour} */ (colours.get(partner.first.sample));
  });
  return ends;
}

/**
 * The positions in `samples` of rows of the embedding.
 * @param {Ends} ends
 * @param {number[]} rows
 */
export const placesOf = (ends, rows) => rows.map((row) => ends.samples.indexOf(row)).filter((place) => place >= 0);
