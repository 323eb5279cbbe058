// A query and its results in 3D, with their correspondences and differences.

import { address, ask } from "./api.js";
import { Differences } from "./difference.js";
import { readGlb } from "./glb.js";
import {
  PLAIN, eigenfunction, heat, placesOf, queryEnds, resultEnds, sameSign, spreadColours,
} from "./matching.js";
import { Stage } from "./stage.js";

/** @import { Model } from "./glb.js" */
/** @import { Ends } from "./matching.js" */
/** @import { View } from "./stage.js" */
/** @import { Embedding, Pair } from "./types.js" */

/**
 * One shape that is shown.
 * @typedef {object} Shown
 * @property {string} name
 * @property {HTMLCanvasElement} canvas
 * @property {() => Promise<ArrayBuffer>} glb
 * @property {() => Promise<Embedding | null>} embedding
 * @property {string | File} [given] Its id, or its file, for the difference from the query.
 * @property {(text: string) => void} [explain] Shows the text on its difference; empty for none.
 * @property {Pair[]} pairs Correspondences with the query; empty for the query itself.
 */

/** @typedef {{ shown: Shown, view: View, ends: Ends }} Side */

/** @param {string} id */
export const storedGlb = async (id) => (await ask(address(`shapes/${id}/preview.glb`))).arrayBuffer();

/** @param {string} id @returns {Promise<Embedding>} */
export const storedEmbedding = async (id) => (await ask(address(`shapes/${id}/embedding`))).json();

/** @type {Stage | undefined} */
let stage;

/** The stage of the page. Throws if the browser has no WebGL. */
export function theStage() {
  try {
    stage ??= new Stage();
  } catch {
    throw new Error("This browser cannot draw in 3D (it has no WebGL). The scores below are not affected.");
  }
  return stage;
}

/** The query and its results, side by side. */
export class Comparison {
  /**
   * @param {Side[]} sides
   * @param {(text: string) => void} tell
   */
  constructor(sides, tell) {
    this.sides = sides;
    this.tell = tell;
    this.row = -1;
    this.differences = new Differences(sides);
    for (const [number, { view, ends }] of sides.entries()) {
      view.setPoints(ends.points, ends.colours, ends.effective);
      view.canvas.addEventListener("pointermove", (event) => {
        if (event.buttons !== 0) return;
        const box = view.canvas.getBoundingClientRect();
        const place = view.pointAt(event.clientX - box.left, event.clientY - box.top);
        if (place >= 0) this.point(number, ends.samples[place]);
      });
    }
  }

  /**
   * Mark a point and its corresponding points on the other shapes.
   * @param {number} number Index of the shape, 0 for the query.
   * @param {number} row Row of its embedding.
   */
  point(number, row) {
    const [query, ...results] = this.sides;
    const pairs = number === 0 ? [] : this.sides[number].shown.pairs;
    const rows = number === 0 ? [row] : pairs.filter((pair) => pair.second.sample === row).map((pair) => pair.first.sample);
    this.row = rows[0] ?? this.row;
    query.view.mark(placesOf(query.ends, rows));
    const lines = [`${query.shown.name}: vertex ${placesOf(query.ends, rows).map((place) => query.ends.vertices[place]).join(", ")}`];
    for (const [i, { view, ends, shown }] of results.entries()) {
      const met = shown.pairs.filter((pair) => rows.includes(pair.first.sample));
      const partners = i + 1 === number ? [row] : [...new Set(met.map((pair) => pair.second.sample))];
      const places = placesOf(ends, partners);
      view.mark(places);
      const vertices = places.map((place) => ends.vertices[place]).join(", ");
      const far = met.length === 0 ? "" : ` (distance ${Math.min(...met.map((pair) => pair.distance)).toFixed(3)})`;
      lines.push(`${shown.name}: vertex ${vertices || "none"}${far}`);
    }
    this.tell(lines.join(" ↔ "));
  }

  /** Mark another point of the query. @param {number} step 1 for the next, -1 for the previous one. */
  step(step) {
    const { samples } = this.sides[0].ends;
    const place = this.row < 0 ? (step > 0 ? -1 : 0) : samples.indexOf(this.row);
    this.point(0, samples[(place + step + samples.length) % samples.length]);
  }

  /** @param {boolean} shown */
  showPoints(shown) {
    for (const { view } of this.sides) view.showPoints(shown);
  }

  /** @param {string} how "plain", "correspondence", "difference", or the number of an eigenmap. */
  async paint(how) {
    this.differences.hide();
    if (how === "difference") {
      await this.differences.show();
    } else if (how === "plain") {
      for (const { view } of this.sides) view.paint(PLAIN);
    } else if (how === "correspondence") {
      for (const { view, ends } of this.sides) view.paint(spreadColours(view.model, ends.points, ends.colours));
    } else {
      await this.paintEigenmap(Number(how));
    }
  }

  /** @param {number} number */
  async paintEigenmap(number) {
    const embeddings = await Promise.all(this.sides.map(({ shown }) => shown.embedding()));
    const query = embeddings[0] && eigenfunction(embeddings[0], number);
    for (const [i, { view, shown }] of this.sides.entries()) {
      const embedding = embeddings[i];
      if (!embedding) continue;
      const values = eigenfunction(embedding, number);
      const sign = i === 0 || !query || sameSign(query, values, shown.pairs) ? 1 : -1;
      const { middle, half } = view.model;
      const points = embedding.positions.map((point) => point.map((value, axis) => (value - middle[axis]) / half));
      view.paint(spreadColours(view.model, points, values.map((value) => heat(sign * value))));
    }
  }
}

/**
 * Load the meshes and put them on the stage.
 * @param {Shown[]} shapes The query first.
 * @param {(text: string) => void} tell
 */
export async function compare(shapes, tell) {
  const place = theStage();
  const models = await Promise.all(shapes.map(async ({ glb }) => readGlb(await glb())));
  place.clear();
  const query = queryEnds(shapes.flatMap(({ pairs }) => pairs), models[0]);
  const sides = shapes.map((shown, i) => ({
    shown,
    view: place.add(shown.canvas, models[i]),
    ends: i === 0 ? query : resultEnds(shown.pairs, models[i], query),
  }));
  return new Comparison(sides, tell);
}

/**
 * Show a single shape.
 * @param {HTMLCanvasElement} canvas
 * @param {Model} model
 */
export function showSingle(canvas, model) {
  theStage().add(canvas, model).paint(PLAIN);
}
