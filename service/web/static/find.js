// Search for similar shapes, by a file or by a stored shape.

import { address, ask, askWith, send } from "./api.js";
import { storedGlb } from "./comparison.js";
import { byId, onDrop, showError, splitList } from "./dom.js";
import { showResults } from "./results.js";

/** @import { Answer } from "./types.js" */

const chosen = byId("find-file", HTMLInputElement);
const progress = byId("find-progress", HTMLElement);
const stage = byId("find-stage", HTMLElement);
const bar = byId("find-bar", HTMLProgressElement);
const errorBox = byId("find-error", HTMLElement);

/** @type {AbortController | null} */
let running = null;

function options() {
  return {
    top_k: byId("find-count", HTMLSelectElement).value,
    rank_by: byId("find-rank", HTMLSelectElement).value,
    filter: splitList(byId("find-tags", HTMLInputElement).value),
    correspondences: "true",
    embedding: "true",
  };
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
 * @param {string} name
 * @param {string | File} given The id of a stored shape, or a file.
 * @param {() => Promise<ArrayBuffer>} glb
 * @param {(signal: AbortSignal) => Promise<Answer>} query
 */
async function run(name, given, glb, query) {
  running?.abort();
  const own = (running = new AbortController());
  const rankBy = byId("find-rank", HTMLSelectElement).value;
  showError(errorBox);
  progress.hidden = false;
  try {
    const answer = await query(own.signal);
    progress.hidden = true;
    await showResults({ name, given, glb }, answer, rankBy, findStored);
  } catch (error) {
    if (!own.signal.aborted) showError(errorBox, error);
  } finally {
    if (running === own) progress.hidden = true;
  }
}

/** @param {File} file */
export function findFile(file) {
  const form = new FormData();
  form.append("file", file);
  return run(
    file.name,
    file,
    async () => (await ask(address("preview"), { method: "POST", body: form })).arrayBuffer(),
    async (signal) => {
      showProgress(0);
      return (await send(address("query", options()), form, showProgress, signal)).body;
    },
  );
}

/** @param {string} id @param {string} name */
export function findStored(id, name) {
  return run(name, id, () => storedGlb(id), (signal) => {
    showProgress(1);
    return askWith(address("query", options()), { shape_id: id }, signal);
  });
}

chosen.addEventListener("change", () => {
  const file = chosen.files?.[0];
  if (file) findFile(file);
  // Allows the user to choose the same file again.
  chosen.value = "";
});
onDrop(byId("find-drop", HTMLElement), (files) => findFile(files[0]));
byId("find-form", HTMLFormElement).addEventListener("submit", (event) => event.preventDefault());
byId("find-stop", HTMLButtonElement).addEventListener("click", () => {
  running?.abort();
  progress.hidden = true;
});
