// One stored shape in 3D, or two side by side with their correspondence.

import { address, ask, askWith } from "./api.js";
import { card, details } from "./card.js";
import { compare, showSingle, storedEmbedding, storedGlb } from "./comparison.js";
import { byId, showError } from "./dom.js";
import { readGlb } from "./glb.js";

/** @import { Comparison, Shape } from "./types.js" */

const cards = byId("cards", HTMLUListElement);
const title = byId("title", HTMLElement);
const { first, second } = byId("main", HTMLElement).dataset;
for (const link of document.querySelectorAll("a[data-view]")) {
  /** @type {HTMLAnchorElement} */ (link).href = address("", { view: link.getAttribute("data-view") ?? "" });
}

/** @param {string} id @returns {Promise<Shape>} */
const read = async (id) => (await ask(address(`shapes/${id}`))).json();

/** @param {string} id */
async function showOne(id) {
  const shape = await read(id);
  title.textContent = document.title = shape.name;
  const { vertices, faces } = shape.facts;
  const lines = [`${vertices} vertices, ${faces} faces`, shape.tags.join(", ")].filter(Boolean);
  const { canvas, item } = card(shape.name, lines, null);
  cards.append(item);
  showSingle(canvas, readGlb(await storedGlb(id)));
}

/** @param {string} one @param {string} other */
async function showTwo(one, other) {
  /** @type {[Shape, Shape, Comparison]} */
  const [a, b, scores] = await Promise.all([
    read(one), read(other), askWith(address("compare"), { first: one, second: other }),
  ]);
  title.textContent = document.title = `${a.name} and ${b.name}`;
  const left = card(a.name, [], null), right = card(b.name, [], scores, details(b.name, scores));
  cards.append(left.item, right.item);
  const shown = await compare(
    [
      { name: a.name, canvas: left.canvas, glb: () => storedGlb(one), embedding: () => storedEmbedding(one), pairs: [] },
      {
        name: b.name, canvas: right.canvas, glb: () => storedGlb(other), embedding: () => storedEmbedding(other),
        pairs: scores.correspondence,
      },
    ],
    (text) => (byId("point-status", HTMLElement).textContent = text),
  );
  await shown.paint("correspondence");
}

const id = location.pathname.split("/").at(-2) ?? "";
(first && second ? showTwo(first, second) : showOne(id)).catch((error) => showError(byId("error", HTMLElement), error));
