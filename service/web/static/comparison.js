// A query and its results in 3D, with what corresponds.

import { address, ask } from "./api.js";
import { readGlb } from "./glb.js";
import { placesOf, queryEnds, resultEnds } from "./matching.js";
import { PLAIN, eigenfunction, heat, sameSign, spread } from "./paint.js";
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
 * @property {Pair[]} pairs From the query; of the query itself, none.
 */

/** @typedef {{ shown: Shown, view: View, ends: Ends }} Side */

/** @param {string} id */
export const storedGlb = async (id) => (await ask(address(`shapes/${id}/preview.glb`))).arrayBuffer();

/** @param {string} id @returns {Promise<Embedding>} */
export const storedEmbedding = async (id) => (await ask(address(`shapes/${id}/embedding`))).json();

/** @type {Stage | undefined} */
let stage;

/** The one stage of a page. Throws where the browser draws nothing in 3D. */
export function theStage() {
  try {
    stage ??= new Stage();
  } catch {
    throw new Error("This browser does not draw in 3D (WebGL); the numbers below hold all the same.");
  }
  return stage;
}

/** The query, first, and its results, beside each other. */
export class Comparison {
  /**
   * @param {Side[]} sides
   * @param {(text: string) => void} tell
   */
  constructor(sides, tell) {
    this.sides = sides;
    this.tell = tell;
    this.row = -1;
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
   * Mark a point and its partners on the other shapes.
   * @param {number} number Of the shape, 0 for the query.
   * @param {number} row Of its embedding.
   */
  point(number, row) {
    const [query, ...results] = this.sides;
    const pairs = number === 0 ? [] : this.sides[number].shown.pairs;
    const rows = number === 0 ? [row] : pairs.filter((pair) => pair.second.sample === row).map((pair) => pair.first.sample);
    this.row = rows[0] ?? this.row;
    query.view.mark(placesOf(query.ends, rows));
    const told = [`${query.shown.name}: vertex ${placesOf(query.ends, rows).map((place) => query.ends.vertices[place]).join(", ")}`];
    for (const [i, { view, ends, shown }] of results.entries()) {
      const met = shown.pairs.filter((pair) => rows.includes(pair.first.sample));
      const partners = i + 1 === number ? [row] : [...new Set(met.map((pair) => pair.second.sample))];
      const places = placesOf(ends, partners);
      view.mark(places);
      const vertices = places.map((place) => ends.vertices[place]).join(", ");
      const far = met.length === 0 ? "" : ` (distance ${Math.min(...met.map((pair) => pair.distance)).toFixed(3)})`;
      told.push(`${shown.name}: vertex ${vertices || "none"}${far}`);
    }
    this.tell(told.join(" ↔ "));
  }

  /** Go on to the query's next point. @param {number} step */
  step(step) {
    const { samples } = this.sides[0].ends;
    const place = this.row < 0 ? (step > 0 ? -1 : 0) : samples.indexOf(this.row);
    this.point(0, samples[(place + step + samples.length) % samples.length]);
  }

  /** @param {boolean} shown */
  showPoints(shown) {
    for (const { view } of this.sides) view.showPoints(shown);
  }

  /** @param {string} how "plain", "correspondence", or the number of an eigenmap. */
  async paint(how) {
    if (how === "plain") {
      for (const { view } of this.sides) view.paint(PLAIN);
    } else if (how === "correspondence") {
      for (const { view, ends } of this.sides) view.paint(spread(view.model, ends.points, ends.colours));
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
      const turned = i === 0 || !query || sameSign(query, values, shown.pairs) ? 1 : -1;
      const { middle, half } = view.model;
      const points = embedding.positions.map((point) => point.map((value, axis) => (value - middle[axis]) / half));
      view.paint(spread(view.model, points, values.map((value) => heat(turned * value))));
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
 * One shape alone.
 * @param {HTMLCanvasElement} canvas
 * @param {Model} model
 */
export function showAlone(canvas, model) {
  theStage().add(canvas, model).paint(PLAIN);
}
