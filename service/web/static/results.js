// What a query found.

import { address } from "./api.js";
import { card } from "./card.js";
import { compare, storedEmbedding, storedGlb, theStage } from "./comparison.js";
import { button, byId, make, showTrouble } from "./dom.js";

/** @import { Comparison } from "./comparison.js" */
/** @import { Answer, Embedding } from "./types.js" */

/**
 * What was asked with.
 * @typedef {object} Asked
 * @property {string} name
 * @property {() => Promise<ArrayBuffer>} glb
 */

const section = byId("results", HTMLElement);
const cards = byId("cards", HTMLUListElement);
const told = byId("point-told", HTMLElement);
const paint = byId("paint", HTMLSelectElement);
const points = byId("points", HTMLInputElement);
const trouble = byId("find-trouble", HTMLElement);

/** @type {Comparison | null} */
let shown = null;

/**
 * @param {Asked} asked
 * @param {Answer} answer
 * @param {(id: string, name: string) => void} findAlike
 */
export async function showResults(asked, answer, findAlike) {
  const { results } = answer;
  shown = null;
  delete cards.dataset.painted;
  section.hidden = false;
  byId("results-summary", HTMLElement).textContent = summary(asked.name, answer);
  const query = card(asked.name, ["the query"], null);
  const found = results.map((result) => {
    const { shape } = result;
    const look = make("a", { href: address(`shapes/${shape.id}/view`) }, `Look at ${shape.name} alone`);
    const alike = button("Find alike", () => findAlike(shape.id, shape.name), `Find shapes like ${shape.name}`);
    const line = make("div", { className: "buttons" }, alike, look);
    return card(`${result.rank}. ${shape.name}`, [shape.tags.join(", ")].filter(Boolean), result, line);
  });
  cards.replaceChildren(query.item, ...found.map(({ item }) => item));
  section.focus();
  try {
    shown = await compare(
      [
        { name: asked.name, canvas: query.canvas, glb: asked.glb, embedding: async () => answer.embedding, pairs: [] },
        ...results.map((result, i) => ({
          name: result.shape.name,
          canvas: found[i].canvas,
          glb: () => storedGlb(result.shape.id),
          embedding: kept(() => storedEmbedding(result.shape.id)),
          pairs: result.correspondence,
        })),
      ],
      (text) => (told.textContent = text),
    );
    shown.showPoints(points.checked);
    await repaint();
  } catch (error) {
    showTrouble(trouble, error);
  }
}

/** Colour the shapes as chosen, and tell when that is done. */
async function repaint() {
  const how = paint.value;
  await shown?.paint(how);
  cards.dataset.painted = how;
}

/** @param {string} name @param {Answer} answer */
function summary(name, answer) {
  if (answer.compared === 0) return `There is nothing to compare ${name} with: no stored shape is meant.`;
  const seconds = (answer.milliseconds.total / 1000).toFixed(2);
  const matched = answer.matched ? "" : " Nothing that is stored is like it: these come nearest.";
  return `${name} was compared with ${answer.compared} of ${answer.stored} stored shapes in ${seconds} s.${matched}`;
}

/**
 * What a function gave the first time.
 * @param {() => Promise<Embedding>} load
 */
function kept(load) {
  /** @type {Promise<Embedding> | undefined} */
  let loaded;
  return () => (loaded ??= load());
}

paint.addEventListener("change", () => repaint().catch((error) => showTrouble(trouble, error)));
points.addEventListener("change", () => shown?.showPoints(points.checked));
byId("previous-point", HTMLButtonElement).addEventListener("click", () => shown?.step(-1));
byId("next-point", HTMLButtonElement).addEventListener("click", () => shown?.step(1));
byId("nearer", HTMLButtonElement).addEventListener("click", () => theStage().approach(1.2));
byId("farther", HTMLButtonElement).addEventListener("click", () => theStage().approach(1 / 1.2));
byId("upright", HTMLButtonElement).addEventListener("click", () => theStage().reset());
const turning = byId("turning", HTMLInputElement);
turning.addEventListener("change", () => theStage().keepTurning(turning.checked));
