// Search for similar shapes, by a file or by a stored shape. A change of an option searches again.

import { address, ask, askWith, formWith, send } from "./api.js";
import { byId, cached, make, showError } from "./dom.js";
import { changedIn, fill, parametersOf, showCount } from "./fields.js";
import { reload } from "./gallery.js";
import { locate } from "./paths.js";
import { shapeCard } from "./shape_card.js";
import { go, linkTo, opensElsewhere } from "./state.js";

/** @import { Asked } from "./results.js" */
/** @import { State } from "./state.js" */
/** @import { Answer, ShapePage } from "./types.js" */

const form = byId("find-form", HTMLFormElement);
const chosen = byId("find-file", HTMLInputElement);
const queryLine = byId("find-query", HTMLElement);
const progress = byId("find-progress", HTMLElement);
const stage = byId("find-stage", HTMLElement);
const bar = byId("find-bar", HTMLProgressElement);
const results = byId("results", HTMLElement);
const start = byId("find-start", HTMLElement);
const errorBox = byId("find-error", HTMLElement);
const count = byId("find-count", HTMLInputElement);
const storeButton = byId("find-store", HTMLButtonElement);

/** Results that *More* adds: a row of four. */
const MORE = 4;

/** What to say of the storing of the query, once. */
let stored = "";

/** @type {AbortController | null} */
let running = null;
/** The query that is shown or runs: its id or file, and its options. @type {{ given: string | File | null, options: string }} */
let asked = { given: null, options: "" };

/** The results are loaded with the first query, because they need the 3D library. */
const loadResults = () => import("./results.js");

/**
 * Show the query of the address.
 * @param {State} state
 */
export function openFind({ parameters, file, fileName }) {
  fill(form, parameters);
  byId("find-rank", HTMLSelectElement).disabled = parametersOf(form).has("partial");
  showCount(form, byId("find-filters", HTMLDetailsElement), byId("find-filter-count", HTMLElement));
  const given = file ?? parameters.get("shape_id");
  const options = parametersOf(form).toString();
  if (given !== null && given === asked.given && options === asked.options) return;
  const isNew = given !== asked.given;
  asked = { given, options };
  running?.abort();
  progress.hidden = true;
  showError(errorBox);
  if (given === null) return clear(fileName);
  run(given, isNew);
}

/** @param {string} fileName The file of the query, if the page has been loaded again since it was chosen. */
function clear(fileName) {
  queryLine.hidden = results.hidden = true;
  showStart();
  if (fileName) showError(errorBox, `Choose ${fileName} again: the address keeps the filters of a search, but not its file.`);
}

function showStart() {
  start.hidden = false;
  openStart();
}

/** @param {number} share Uploaded share of the file, 0 to 1. */
function showProgress(share) {
  if (share < 1) {
    stage.textContent = "Uploading";
    bar.value = share;
  } else {
    stage.textContent = "Computing and comparing";
    bar.removeAttribute("value");
  }
}

/**
 * @param {string | File} given The id of a stored shape, or a file.
 * @param {boolean} isNew Whether another query was shown before.
 */
async function run(given, isNew) {
  const own = (running = new AbortController());
  progress.hidden = false;
  start.hidden = true;
  if (isNew) results.hidden = queryLine.hidden = true;
  try {
    const [query, answer, { showResults }] = await Promise.all([
      given instanceof File ? ofFile(given) : ofStored(given, own.signal),
      given instanceof File ? queryFile(given, own.signal) : queryStored(given, own.signal),
      loadResults(),
    ]);
    if (own.signal.aborted) return;
    progress.hidden = true;
    byId("find-name", HTMLElement).textContent = query.name;
    storeButton.hidden = !(given instanceof File);
    byId("find-share", HTMLElement).textContent = given instanceof File
      ? "The link of this page keeps the filters, but not the file." : `${stored}The link of this page leads to these results.`;
    stored = "";
    queryLine.hidden = false;
    await showResults(query, answer, Number(count.value), isNew);
  } catch (error) {
    if (own.signal.aborted) return;
    results.hidden = true;
    showStart();
    showError(errorBox, error);
  } finally {
    if (running === own) progress.hidden = true;
  }
}

/** The options of a search, and fields of the answer that the page shows. */
function options() {
  const parameters = parametersOf(form);
  parameters.set("correspondences", "true");
  parameters.set("embedding", "true");
  return parameters;
}

/** @type {WeakMap<File, Asked>} */
const previews = new WeakMap();

/** @param {File} file @returns {Asked} */
function ofFile(file) {
  const known = previews.get(file);
  if (known) return known;
  const body = formWith({ file });
  const glb = cached(async () => (await ask(address("preview"), { method: "POST", body })).arrayBuffer());
  const made = { name: file.name, given: file, glb };
  previews.set(file, made);
  return made;
}

/** @param {string} id @param {AbortSignal} signal @returns {Promise<Asked>} */
async function ofStored(id, signal) {
  const { name } = await (await ask(address(`shapes/${id}`), { signal })).json();
  return { name, given: id, glb: async () => (await ask(address(`shapes/${id}/preview.glb`))).arrayBuffer() };
}

/** @param {File} file @param {AbortSignal} signal @returns {Promise<Answer>} */
async function queryFile(file, signal) {
  showProgress(0);
  return (await send(address("query", options()), formWith({ file }), showProgress, signal)).body;
}

/** @param {string} id @param {AbortSignal} signal @returns {Promise<Answer>} */
function queryStored(id, signal) {
  showProgress(1);
  return askWith(address("query", options()), { shape_id: id }, signal);
}

/** @param {File[]} files */
export function findFile(files) {
  if (files.length === 1) return go("find", changedIn(form), files[0]);
  go("find", changedIn(form));
  showError(errorBox, "A search takes one file. Upload stores many.");
}

/** Search again with the options of the form. */
function searchAgain() {
  const parameters = changedIn(form);
  if (typeof asked.given === "string") parameters.set("shape_id", asked.given);
  go("find", parameters, asked.given instanceof File ? asked.given : null);
}

chosen.addEventListener("change", () => {
  const given = [...(chosen.files ?? [])];
  // Allows the user to choose the same file again.
  chosen.value = "";
  if (given.length > 0) findFile(given);
});
form.addEventListener("change", (event) => {
  if (event.target !== chosen) searchAgain();
});
form.addEventListener("submit", (event) => {
  event.preventDefault();
  searchAgain();
});
byId("find-stop", HTMLButtonElement).addEventListener("click", () => {
  running?.abort();
  progress.hidden = true;
  asked.options = "";
});
byId("results-more", HTMLButtonElement).addEventListener("click", () => {
  count.value = String(Number(count.value) + MORE);
  searchAgain();
});
storeButton.addEventListener("click", async () => {
  const { given } = asked;
  if (!(given instanceof File)) return;
  storeButton.disabled = true;
  try {
    const { status, body } = await send(address("shapes"), formWith({ file: given }), () => {});
    reload();
    if (asked.given !== given) return;
    stored = status === 201 ? "Stored. " : "It was stored already. ";
    const parameters = changedIn(form);
    parameters.set("shape_id", body.id);
    go("find", parameters);
  } catch (error) {
    showError(errorBox, error);
  } finally {
    storeButton.disabled = false;
  }
});
byId("find-clear", HTMLButtonElement).addEventListener("click", () => {
  go("find", changedIn(form));
  chosen.focus();
});
// "Find similar" keeps the options of the form.
document.addEventListener("click", (event) => {
  const link = event.target instanceof Element ? event.target.closest("a[data-shape]") : null;
  if (!(link instanceof HTMLAnchorElement) || opensElsewhere(event)) return;
  event.preventDefault();
  const parameters = changedIn(form);
  parameters.set("shape_id", link.dataset.shape ?? "");
  go("find", parameters);
});

const SHOWN = "12";

/** Show them, or how to begin where nothing is stored. */
async function openStart() {
  try {
    /** @type {ShapePage} */
    const { shapes, total } = await (await ask(address("shapes", { limit: SHOWN }))).json();
    const link = total === 0 ? make("a", { href: linkTo("upload") }, "Upload the first shapes")
      : make("a", { href: linkTo("browse") }, `Browse all ${total}`);
    link.dataset.view = total === 0 ? "upload" : "browse";
    byId("start-text", HTMLElement).replaceChildren(
      total === 0 ? "No shapes are stored yet. " : "Or start from a stored shape. ", link,
    );
    byId("start-shapes", HTMLUListElement).replaceChildren(...shapes.map((shape) => shapeCard(shape)));
    await locate(byId("start-shapes", HTMLUListElement));
  } catch (error) {
    showError(byId("find-error", HTMLElement), error);
  }
}
