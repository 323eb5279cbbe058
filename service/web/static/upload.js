// Uploads of files, each with its progress and outcome, and of archives, which the service unpacks in the background.

import { address, ask, formWith, send } from "./api.js";
import { button, byId, make, messageOf } from "./dom.js";
import { reload } from "./gallery.js";

/** @import { Job, JobFilePage, JobPage } from "./types.js" */

const AT_ONCE = 2;
const ENDINGS = /\.zip$/i;
const REFUSED = "100";

const chosen = byId("upload-files", HTMLInputElement);
const uploads = byId("uploads", HTMLUListElement);
const jobs = byId("jobs", HTMLUListElement);
const status = byId("upload-status", HTMLElement);

/** @type {(() => Promise<void>)[]} */
const waiting = [];
let active = 0;
const outcomes = { stored: 0, there: 0, failed: 0 };
/** The jobs that are shown. @type {Set<string>} */
const shown = new Set();

/** @param {File[]} files */
export function store(files) {
  const tags = byId("upload-tags", HTMLInputElement).value.trim();
  for (const file of files) {
    if (ENDINGS.test(file.name)) sendArchive(file, tags);
    else waiting.push(upload(file, tags));
  }
  for (let i = active; i < AT_ONCE; i++) work();
}

/**
 * Add the line of a file or an archive to a list.
 * @param {HTMLUListElement} list
 * @param {string} name
 */
function row(list, name) {
  const bar = make("progress", { max: 1, value: 0, ariaLabel: `Progress of ${name}` });
  const outcome = make("span", {}, "waiting");
  const line = make("li", {}, make("span", { className: "name" }, name), bar, outcome);
  list.append(line);
  return { name, bar, outcome, line };
}

/** @typedef {ReturnType<typeof row>} Row */

/**
 * Show the error that ended an upload.
 * @param {Row} own
 * @param {string} text
 */
function fail({ bar, outcome }, text) {
  bar.hidden = true;
  outcome.className = "bad";
  outcome.textContent = text;
}

/**
 * Add a file to the list; the returned function sends it.
 * @param {File} file
 * @param {string} tags
 */
function upload(file, tags) {
  const own = row(uploads, file.name);
  const { bar, outcome } = own;
  return async () => {
    try {
      const { status: code } = await send(address("shapes"), formWith({ file, tags }), (share) => {
        bar.value = share;
        outcome.textContent = share < 1 ? "uploading" : "computing";
        if (share === 1) bar.removeAttribute("value");
      });
      bar.value = 1;
      outcome.textContent = code === 201 ? "stored" : "already stored";
      outcomes[code === 201 ? "stored" : "there"]++;
    } catch (error) {
      fail(own, messageOf(error));
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

/** Show all unfinished jobs. */
export async function openJobs() {
  /** @type {JobPage} */
  const page = await (await ask(address("jobs", { limit: "20" }))).json();
  for (const job of page.jobs) if (job.ended_at === null && !shown.has(job.id)) follow(job, row(jobs, job.archive));
}

/**
 * Send an archive and show its progress.
 * @param {File} file
 * @param {string} tags
 */
async function sendArchive(file, tags) {
  const own = row(jobs, file.name);
  try {
    const { body } = await send(address("jobs"), formWith({ file, tags }), (share) => {
      own.bar.value = share;
      own.outcome.textContent = "uploading";
    });
    follow(body, own);
  } catch (error) {
    fail(own, messageOf(error));
  }
}

/**
 * Show the progress of a job until it ends.
 * @param {Job} job
 * @param {Row} own
 */
function follow(job, own) {
  shown.add(job.id);
  const stop = button("Cancel", async () => {
    stop.disabled = true;
    try {
      await (await ask(address(`jobs/${job.id}/cancel`), { method: "POST" })).text();
    } catch (error) {
      fail(own, messageOf(error));
    }
  }, `Cancel ${own.name}`);
  own.line.append(stop);
  tell(job, own);
  const source = new EventSource(address(`jobs/${job.id}/events`));
  source.addEventListener("progress", (event) => tell(JSON.parse(event.data), own));
  source.addEventListener("end", (event) => {
    source.close();
    stop.remove();
    finish(JSON.parse(event.data), own);
  });
  source.addEventListener("error", () => {
    // While it is CONNECTING, the browser reconnects by itself.
    if (source.readyState !== EventSource.CLOSED) return;
    stop.remove();
    fail(own, "The service no longer reports progress.");
  });
}

/**
 * @param {Job} job
 * @param {Row} own
 */
function tell(job, own) {
  const { files, waiting, stored, present, refused, ignored } = job.counts;
  if (files === 0) {
    own.bar.removeAttribute("value");
    own.outcome.textContent = job.state === "waiting" ? "waiting" : "listing files";
    return;
  }
  own.bar.value = (files - waiting) / files;
  const left = job.remaining_seconds === null ? "" : `, about ${Math.ceil(job.remaining_seconds)} s left`;
  own.outcome.textContent = `${stored} of ${files - ignored} stored, ${present} already stored, ${refused - ignored} not stored${left}`;
}

/**
 * @param {Job} job
 * @param {Row} own
 */
async function finish(job, own) {
  tell(job, own);
  if (job.problem) fail(own, `${job.problem.title}: ${job.problem.detail}`);
  if (job.state === "cancelled") own.outcome.textContent = `cancelled, ${job.counts.stored} stored`;
  reload();
  if (job.counts.refused === job.counts.ignored) return;
  /** @type {JobFilePage} */
  const page = await (await ask(address(`jobs/${job.id}/files`, { outcome: "refused", limit: REFUSED }))).json();
  const meshes = page.files.filter((file) => file.problem?.type !== "urn:isoshape:problem:unknown-format");
  const causes = meshes.map((file) => make("li", {}, `${file.path}: ${file.problem?.detail ?? ""}`));
  if (page.next_cursor) causes.push(make("li", {}, "More files were refused."));
  own.line.append(make("ul", { className: "bad" }, ...causes));
}

chosen.addEventListener("change", () => {
  store([...(chosen.files ?? [])]);
  chosen.value = "";
});
byId("upload-form", HTMLFormElement).addEventListener("submit", (event) => event.preventDefault());
