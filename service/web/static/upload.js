// Uploads of many files, each with its own progress and outcome.

import { address, send } from "./api.js";
import { byId, make } from "./dom.js";
import { reload } from "./gallery.js";
import { isArchive, sendArchive } from "./jobs.js";

const AT_ONCE = 2;

const chosen = byId("upload-files", HTMLInputElement);
const list = byId("uploads", HTMLUListElement);
const status = byId("upload-status", HTMLElement);

/** @type {(() => Promise<void>)[]} */
const waiting = [];
let active = 0;
const outcomes = { stored: 0, there: 0, failed: 0 };

/** @param {File[]} files */
export function store(files) {
  const tags = byId("upload-tags", HTMLInputElement).value.trim();
  for (const file of files) {
    if (isArchive(file)) sendArchive(file, tags);
    else waiting.push(job(file, tags));
  }
  for (let i = active; i < AT_ONCE; i++) work();
}

/**
 * Add a file to the list; the returned function sends it.
 * @param {File} file
 * @param {string} tags
 */
function job(file, tags) {
  const bar = make("progress", { max: 1, value: 0, ariaLabel: `Progress of ${file.name}` });
  const outcome = make("span", {}, "waiting");
  list.append(make("li", {}, make("span", { className: "name" }, file.name), bar, outcome));
  return async () => {
    const form = new FormData();
    form.append("file", file);
    if (tags) form.append("tags", tags);
    try {
      const { status: code } = await send(address("shapes"), form, (share) => {
        bar.value = share;
        outcome.textContent = share < 1 ? "uploading" : "computing";
        if (share === 1) bar.removeAttribute("value");
      });
      bar.value = 1;
      outcome.textContent = code === 201 ? "stored" : "already stored";
      outcomes[code === 201 ? "stored" : "there"]++;
    } catch (error) {
      bar.hidden = true;
      outcome.className = "bad";
      outcome.textContent = error instanceof Error ? error.message : String(error);
      outcomes.failed++;
    }
  };
}

async function work() {
  if (waiting.length === 0) return;
  active++;
  for (let next = waiting.shift(); next; next = waiting.shift()) {
    await next();
    const { stored, there, failed } = outcomes;
    status.textContent = `${stored} stored, ${there} already stored, ${failed} not stored, ${waiting.length} waiting`;
  }
  active--;
  if (active === 0) reload();
}

chosen.addEventListener("change", () => {
  store([...(chosen.files ?? [])]);
  chosen.value = "";
});
byId("upload-form", HTMLFormElement).addEventListener("submit", (event) => event.preventDefault());
