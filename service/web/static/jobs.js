// Archives, which the service unpacks and stores in the background: progress and refused files.

import { address, ask, send } from "./api.js";
import { button, byId, make } from "./dom.js";
import { reload } from "./gallery.js";

/** @import { Job, JobFilePage, JobPage } from "./types.js" */

const ENDINGS = /\.zip$/i;
const REFUSED = "100";

const list = byId("jobs", HTMLUListElement);
/** @type {Set<string>} */
const shown = new Set();

/**
 * Whether a file is sent as an archive.
 * @param {File} file
 */
export const isArchive = (file) => ENDINGS.test(file.name);

/** Show all unfinished jobs. */
export async function openJobs() {
  /** @type {JobPage} */
  const page = await (await ask(address("jobs", { limit: "20" }))).json();
  for (const job of page.jobs) if (job.ended_at === null && !shown.has(job.id)) follow(job, row(job.archive));
}

/**
 * Send an archive and show its progress.
 * @param {File} file
 * @param {string} tags
 */
export async function sendArchive(file, tags) {
  const own = row(file.name);
  const form = new FormData();
  form.append("file", file);
  if (tags) form.append("tags", tags);
  try {
    const { body } = await send(address("jobs"), form, (share) => {
      own.bar.value = share;
      own.outcome.textContent = "uploading";
    });
    follow(body, own);
  } catch (error) {
    fail(own, error instanceof Error ? error.message : String(error));
  }
}

/**
 * Create the line of an archive.
 * @param {string} name
 */
function row(name) {
  const bar = make("progress", { max: 1, value: 0, ariaLabel: `Progress of ${name}` });
  const outcome = make("span", {}, "waiting");
  const line = make("li", {}, make("span", { className: "name" }, name), bar, outcome);
  list.append(line);
  return { name, bar, outcome, line };
}

/** @typedef {ReturnType<typeof row>} Row */

/**
 * @param {Row} own
 * @param {string} text
 */
function fail(own, text) {
  own.bar.hidden = true;
  own.outcome.className = "bad";
  own.outcome.textContent = text;
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
      await ask(address(`jobs/${job.id}/cancel`), { method: "POST" });
    } catch (error) {
      fail(own, error instanceof Error ? error.message : String(error));
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
  const { files, waiting, stored, present, refused } = job.counts;
  if (files === 0) {
    own.bar.removeAttribute("value");
    own.outcome.textContent = job.state === "waiting" ? "waiting" : "listing files";
    return;
  }
  own.bar.value = (files - waiting) / files;
  const left = job.remaining_seconds === null ? "" : `, about ${Math.ceil(job.remaining_seconds)} s left`;
  own.outcome.textContent = `${stored} of ${files} stored, ${present} already stored, ${refused} not stored${left}`;
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
  if (job.counts.refused === 0) return;
  /** @type {JobFilePage} */
  const page = await (await ask(address(`jobs/${job.id}/files`, { outcome: "refused", limit: REFUSED }))).json();
  const causes = page.files.map((file) => make("li", {}, `${file.path}: ${file.problem?.detail ?? ""}`));
  if (page.next_cursor) causes.push(make("li", {}, "More files were refused."));
  own.line.append(make("ul", { className: "bad" }, ...causes));
}
