// One stored shape, or two side by side in 3D with their correspondence.

import { address, askWith, readShape } from "./api.js";
import { card, details } from "./card.js";
import { compare, storedEmbedding, storedGlb, theStage } from "./comparison.js";
import { byId, showError } from "./dom.js";
import { offerLandmarks } from "./landmarks.js";
import { showShape } from "./shape_page.js";
import { offerAxes } from "./up.js";
import "./tags.js";

/** @import { Comparison, Shape } from "./types.js" */

const cards = byId("cards", HTMLUListElement);
const title = byId("title", HTMLElement);
offerAxes(byId("up", HTMLSelectElement), (axis) => theStage().setUp(axis));
const { first, second } = byId("main", HTMLElement).dataset;
for (const link of document.querySelectorAll("a[data-view]")) {
  /** @type {HTMLAnchorElement} */ (link).href = address("", { view: link.getAttribute("data-view") ?? "" });
}

/** @param {string} one @param {string} other */
async function showTwo(one, other) {
  /** @type {[Shape, Shape, Comparison]} */
  const [a, b, scores] = await Promise.all([
    readShape(one), readShape(other), askWith(address("compare"), { first: one, second: other }),
  ]);
  title.textContent = document.title = `${a.name} and ${b.name}`;
  const left = card(a.name, [], null), right = card(b.name, [], scores, details(b.name, scores));
  cards.append(left.item, right.item);
  const status = byId("point-status", HTMLElement);
  status.textContent = "Point at a coloured dot to see its partner. Click on the first shape to place a landmark.";
  status.hidden = false;
  const shown = await compare(
    [
      { name: a.name, canvas: left.canvas, glb: () => storedGlb(one), embedding: () => storedEmbedding(one), pairs: [] },
      {
        name: b.name, canvas: right.canvas, glb: () => storedGlb(other), embedding: () => storedEmbedding(other),
        pairs: scores.correspondence,
      },
    ],
    (text) => (status.textContent = text),
  );
  const [query, copy] = shown.sides.map(({ view }) => view);
  if (scores.transform) copy.place(query, scores.transform, scores.likeness === "mirrored");
  await shown.paint("correspondence");
  offerLandmarks([query, copy], [one, other], [a.name, b.name]);
}

const id = first || (location.pathname.split("/").at(-2) ?? "");
const beside = second || new URLSearchParams(location.search).get("beside");
(beside ? showTwo(id, beside) : showShape(id)).catch((error) => showError(byId("error", HTMLElement), error));
