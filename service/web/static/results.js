// Results of a query.

import { address } from "./api.js";
import { card, details } from "./card.js";
import { compare, storedEmbedding, storedGlb, theStage } from "./comparison.js";
import { saveTable } from "./csv.js";
import { listen } from "./difference.js";
import { byId, cached, make, showError } from "./dom.js";
import { measures, sizes } from "./facts.js";
import { similarLink } from "./shape_card.js";
import { offerAxes } from "./up.js";

/** @import { Comparison } from "./comparison.js" */
/** @import { Answer, Result } from "./types.js" */

/**
 * The query.
 * @typedef {object} Asked
 * @property {string} name
 * @property {() => Promise<ArrayBuffer>} glb
 * @property {string | File} given Its id or its file.
 */

const section = byId("results", HTMLElement);
const cards = byId("cards", HTMLUListElement);
const status = byId("point-status", HTMLElement);
const paint = byId("paint", HTMLSelectElement);
const points = byId("points", HTMLInputElement);
const errorBox = byId("find-error", HTMLElement);

/** The most results that one query has. */
const MOST = 100;

/** @type {Comparison | null} */
let shown = null;
/** The results, and the name of what was asked. @type {{ name: string, results: Result[] }} */
let listed = { name: "", results: [] };

/**
 * @param {Asked} asked
 * @param {Answer} answer
 * @param {number} count The number of results that was asked for.
 * @param {boolean} isNew Whether another query was shown before; then the results get the focus.
 */
export async function showResults(asked, answer, count, isNew) {
  const results = [...answer.results, ...answer.parts];
  listed = { name: asked.name, results };
  const most = Math.min(answer.compared, MOST);
  byId("results-more", HTMLButtonElement).hidden = answer.results.length < count || answer.results.length >= most;
  byId("results-export", HTMLButtonElement).hidden = results.length === 0;
  shown?.differences.hide();
  shown = null;
  delete cards.dataset.painted;
  section.hidden = false;
  byId("results-summary", HTMLElement).textContent = summary(asked.name, answer);
  const warnings = byId("results-warnings", HTMLElement);
  const others = answer.warnings.filter((warning) => !warning.startsWith(OTHER_ORDER));
  warnings.hidden = others.length === 0;
  warnings.textContent = others.map(sentence).join(" ");
  const first = card(asked.name, ["Query", sizes(answer.query)], null);
  byId("legend-text", HTMLElement).textContent = results.length === 0 ? ""
    : `Each result shows its difference from the query; the query shows its difference from ${results[0].shape.name}.`;
  /** @type {HTMLElement[]} */
  const notes = [];
  const found = results.map((result) => {
    const { shape } = result;
    /** @type {[string, string][]} */
    const part = result.part_distance === null ? [] : [["part distance", result.part_distance.toFixed(4)]];
    const more = details(shape.name, result, [...part, ...measures(shape, result.size_ratio)]);
    const open = make("a", { href: address(`shapes/${shape.id}/view`), ariaLabel: `Open ${shape.name}` }, "Open");
    // A file that is not stored has no page to be compared on.
    const compared = typeof asked.given === "string" ? [make("a", {
      href: address(`shapes/${asked.given}/view`, { beside: shape.id }), ariaLabel: `Compare with ${shape.name}`,
      title: "Both side by side, with landmarks",
    }, "Compare")] : [];
    const line = make("div", { className: "buttons" }, similarLink(shape), open, ...compared);
    const note = make("p", { className: "difference" });
    notes.push(note);
    return card(`${result.rank}. ${shape.name}`, [sizes(shape), shape.tags.join(", ")].filter(Boolean), result, note, more, line);
  });
  cards.replaceChildren(first.item, ...found.map(({ item }) => item));
  if (isNew) {
    // Not the end of the section, to which the focus alone would scroll.
    section.focus({ preventScroll: true });
    first.item.scrollIntoView({ block: "nearest" });
  }
  try {
    shown = await compare(
      [
        { ...asked, canvas: first.canvas, embedding: async () => answer.embedding, pairs: [] },
        ...results.map((result, i) => ({
          name: result.shape.name,
          canvas: found[i].canvas,
          glb: () => storedGlb(result.shape.id),
          embedding: cached(() => storedEmbedding(result.shape.id)),
          pairs: result.correspondence,
          given: result.shape.id,
          explain: (/** @type {string} */ text) => (notes[i].textContent = text),
        })),
      ],
      (text) => (status.textContent = text),
    );
    const [query, ...others] = shown.sides.map(({ view }) => view);
    for (const [i, { transform, likeness }] of results.entries()) {
      if (transform) others[i].place(query, transform, likeness === "mirrored");
    }
    await repaint();
  } catch (error) {
    showError(errorBox, error);
  }
}

/** Colour the shapes as selected; `data-painted` names the colouring when it is done. */
async function repaint() {
  const how = paint.value;
  byId("legend", HTMLElement).hidden = how !== "difference";
  // Dots in the colours of the correspondence would hide the difference.
  shown?.showPoints(points.checked && how !== "difference");
  await shown?.paint(how);
  if (paint.value === how) cards.dataset.painted = how;
}

/** @param {string} text */
const sentence = (text) => `${text[0].toUpperCase()}${text.slice(1)}.`;

/** How the warning begins that an order is not known yet. The summary has the rest. */
const OTHER_ORDER = "the order is that of combined";

/** @param {string} name @param {Answer} answer */
function summary(name, answer) {
  if (answer.compared === 0) return `There are no stored shapes to compare ${name} with, or none passes the filters.`;
  const seconds = (answer.milliseconds.total / 1000).toFixed(2);
  const alike = answer.matched || answer.ranked_by === "part_distance";
  // The spin images of a part decide, whatever score is chosen.
  const order = answer.ranked_by === "part_distance" ? "part distance, the least first" : answer.ranked_by;
  const reason = answer.warnings.find((warning) => warning.startsWith(OTHER_ORDER))?.slice(OTHER_ORDER.length) ?? "";
  const matched = alike ? "" : " No stored shape is similar to it; these are the closest.";
  return `${name} was compared with ${answer.compared} of ${answer.stored} stored shapes in ${seconds} s. `
    + `The results are sorted by ${order}${reason}.${matched}`;
}

/** @type {[string, (result: Result) => string | number | null][]} */
const COLUMNS = [
  ["rank", ({ rank }) => rank],
  ["id", ({ shape }) => shape.id],
  ["name", ({ shape }) => shape.name],
  ["tags", ({ shape }) => shape.tags.join(", ")],
  ["likeness", ({ likeness }) => likeness],
  ["instances", ({ instances }) => instances?.text ?? ""],
  ["scale", ({ scale }) => scale],
  ["difference", ({ difference }) => difference?.text ?? ""],
  ["cc", ({ cc }) => cc],
  ["ssd", ({ ssd }) => ssd],
  ["sim", ({ sim }) => sim],
  ["combined", ({ combined }) => combined],
  ["part_distance", ({ part_distance }) => part_distance],
  ["size_ratio", ({ size_ratio }) => size_ratio],
  ["unit", ({ shape }) => shape.unit],
  ["length", ({ shape }) => shape.facts.bounding_box[0]],
  ["width", ({ shape }) => shape.facts.bounding_box[1]],
  ["height", ({ shape }) => shape.facts.bounding_box[2]],
  ["area", ({ shape }) => shape.facts.area],
  ["volume", ({ shape }) => shape.facts.closed ? shape.facts.volume : null],
];

byId("results-export", HTMLButtonElement).addEventListener("click", () => saveTable(`similar to ${listed.name}.csv`, [
  COLUMNS.map(([name]) => name), ...listed.results.map((result) => COLUMNS.map(([, value]) => value(result))),
]));
listen(() => shown?.differences);
paint.addEventListener("change", () => repaint().catch((error) => showError(errorBox, error)));
points.addEventListener("change", () => shown?.showPoints(points.checked && paint.value !== "difference"));
byId("previous-point", HTMLButtonElement).addEventListener("click", () => shown?.step(-1));
byId("next-point", HTMLButtonElement).addEventListener("click", () => shown?.step(1));
byId("zoom-in", HTMLButtonElement).addEventListener("click", () => theStage().zoomBy(1.2));
byId("zoom-out", HTMLButtonElement).addEventListener("click", () => theStage().zoomBy(1 / 1.2));
byId("reset-view", HTMLButtonElement).addEventListener("click", () => theStage().reset());
offerAxes(byId("up", HTMLSelectElement), (axis) => theStage().setUp(axis));
const rotate = byId("auto-rotate", HTMLInputElement);
rotate.addEventListener("change", () => theStage().setAutoRotate(rotate.checked));
// On a small screen the shapes come first.
byId("display", HTMLDetailsElement).open = !matchMedia("(max-width: 40rem)").matches;
