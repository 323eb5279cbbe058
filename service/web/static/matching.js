// Corresponding points, and colours: of points by position, of surfaces by the colours of points.

import { placed } from "./glb.js";

/** @import { Model } from "./glb.js" */
/** @import { Embedding, Pair } from "./types.js" */

/** @typedef {[number, number, number]} Colour Red, green and blue from 0 to 1. */

/** @type {Colour} */
export const PLAIN = [0.5, 0.62, 0.79];

const NEIGHBOURS = 3;

/**
 * A colour for each point: red, green and blue along the x, y and z axes of the upright model.
 * @param {Model} model
 * @param {number[][]} points In the coordinates of the model.
 * @returns {Colour[]}
 */
export function coloursOfPoints(model, points) {
  const m = model.matrix;
  const turned = points.map(([x, y, z]) => [0, 1, 2].map((i) => m[i] * x + m[4 + i] * y + m[8 + i] * z));
  const low = [0, 1, 2].map((axis) => Math.min(...turned.map((point) => point[axis])));
  const high = [0, 1, 2].map((axis) => Math.max(...turned.map((point) => point[axis])));
  return turned.map((point) => {
    const [r, g, b] = point.map((value, i) => 0.1 + (0.9 * (value - low[i])) / (high[i] - low[i] || 1));
    return [r, g, b];
  });
}

/**
 * A colour for each vertex: the mean colour of the nearest points, weighted by inverse squared distance.
 * @param {Model} model
 * @param {number[][]} points
 * @param {Colour[]} colours
 */
export function spreadColours(model, points, colours) {
  const { positions } = model;
  const painted = new Float32Array(positions.length);
  const near = new Array(NEIGHBOURS).fill(0);
  const distances = new Array(NEIGHBOURS).fill(0);
  const [xs, ys, zs] = [0, 1, 2].map((axis) => Float64Array.from(points, (point) => point[axis]));
  for (let v = 0; v < positions.length; v += 3) {
    distances.fill(Infinity);
    for (let p = 0; p < xs.length; p++) {
      const d = (positions[v] - xs[p]) ** 2 + (positions[v + 1] - ys[p]) ** 2 + (positions[v + 2] - zs[p]) ** 2;
      if (d >= distances[NEIGHBOURS - 1]) continue;
      let place = NEIGHBOURS - 1;
      for (; place > 0 && distances[place - 1] > d; place--) {
        distances[place] = distances[place - 1];
        near[place] = near[place - 1];
      }
      distances[place] = d;
      near[place] = p;
    }
    let total = 0;
    for (let i = 0; i < NEIGHBOURS && distances[i] < Infinity; i++) {
      const weight = 1 / (distances[i] + 1e-9);
      total += weight;
      for (let c = 0; c < 3; c++) painted[v + c] += weight * colours[near[i]][c];
    }
    for (let c = 0; c < 3; c++) painted[v + c] /= total || 1;
  }
  return painted;
}

/**
 * The values of an eigenfunction at the samples, from -1 to 1.
 * @param {Embedding} embedding
 * @param {number} number 1 for the first.
 */
export function eigenfunction(embedding, number) {
  const spectrum = embedding.spectra.find(({ name }) => name === "laplace-beltrami") ?? embedding.spectra[0];
  const column = Math.min(number, spectrum.coordinates[0].length) - 1;
  const values = embedding.positions.map((_, sample) => spectrum.coordinates[sample][column]);
  const most = Math.max(...values.map(Math.abs)) || 1;
  return values.map((value) => value / most);
}

/**
 * Whether two eigenfunctions, whose signs are arbitrary, agree in sign at corresponding points.
 * @param {number[]} first
 * @param {number[]} second
 * @param {Pair[]} pairs
 */
export function sameSign(first, second, pairs) {
  return pairs.reduce((sum, pair) => sum + first[pair.first.sample] * second[pair.second.sample], 0) >= 0;
}

/**
 * Blue for -1, white for 0, red for 1.
 * @param {number} value
 * @returns {Colour}
 */
export function heat(value) {
  const far = Math.min(1, Math.abs(value));
  const end = value < 0 ? [0.1, 0.3, 0.85] : [0.85, 0.15, 0.1];
  const [r, g, b] = end.map((part) => 1 - far * (1 - part));
  return [r, g, b];
}

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
