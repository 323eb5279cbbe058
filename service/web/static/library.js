// The library: folders that stay in place, their states, and what is missing in them.

import { address, ask } from "./api.js";
import { button, byId, countOf, make, showError } from "./dom.js";
import { moment } from "./facts.js";
import { current } from "./state.js";

/** @import { Source, SourceFile, SourceFilePage } from "./types.js" */

const LOOK_MILLISECONDS = 1000;
/** Missing or refused files that are listed. */
const SHOWN = 200;

const list = byId("sources", HTMLUListElement);
const status = byId("library-status", HTMLElement);
const errorBox = byId("library-error", HTMLElement);

/** Number of the current list; a response for an earlier list is discarded. */
let generation = 0;
/** The open lists of files, by source and state. @type {Set<string>} */
const open = new Set();

/** Show the sources, and again while one of them is scanned. */
export async function openLibrary() {
  const own = ++generation;
  try {
    for (let active = true; active && current().view === "library";) {
      /** @type {{ sources: Source[] }} */
      const { sources } = await (await ask(address("sources"))).json();
      if (own !== generation) return;
      showError(errorBox);
      show(sources);
      active = sources.some(({ state }) => state === "scanning" || state === "waiting");
      if (active) await new Promise((resolve) => setTimeout(resolve, LOOK_MILLISECONDS));
      if (own !== generation) return;
    }
  } catch (error) {
    if (own !== generation) return;
    status.textContent = "";
    showError(errorBox, error);
  }
}

/** @param {Source[]} sources */
function show(sources) {
  status.textContent = sources.length > 0 ? ""
    : "No folders yet. On the machine of the service, `isoshape library add FOLDER` has the meshes of a folder here; they stay where they are.";
  const focused = document.activeElement instanceof HTMLElement ? document.activeElement.dataset.act : undefined;
  list.replaceChildren(...sources.map(item));
  if (focused) /** @type {HTMLElement | null} */ (list.querySelector(`[data-act="${CSS.escape(focused)}"]`))?.focus();
}

/** @param {Source} source */
function item(source) {
  const { id, name, path, state, detail, counts, scan, scanned_at } = source;
  const busy = state === "scanning" || state === "waiting";
  const scanned = scanned_at === null ? "never"
    : make("time", { dateTime: scanned_at }, moment(scanned_at));
  const made = make(
    "li", {},
    make("span", { className: "name" }, name),
    make("span", { className: "path" }, path),
    make("span", {}, `${countOf(counts.present, "file")}, ${WORDS[state](source)}. Last scan: `, scanned),
    make("div", { className: "buttons" }, act("rescan", "Rescan", source, busy)),
  );
  if (state === "offline") {
    made.lastElementChild?.append(act("confirm", "Confirm the loss", source, busy));
    made.append(make("p", { className: "warning" }, `Offline: ${detail}. Nothing is deleted until the folder is back, or you confirm that its files are gone.`));
  }
  for (const [kind, count] of /** @type {[string, number][]} */ ([
    ["missing", counts.missing], ["refused", counts.refused], ["unreadable", counts.unreadable],
  ])) {
    if (count > 0) made.append(files(id, kind, `${count} ${kind}`));
  }
  if (counts.present > 1) made.append(files(id, EQUAL, "Files that are there more than once"));
  for (const [place, reason] of Object.entries(scan.unread)) {
    made.append(make("p", { className: "warning" }, `${place} is left out: ${reason}`));
  }
  return made;
}

/** What a state means. @type {Record<string, (source: Source) => string>} */
const WORDS = {
  waiting: () => "waiting for a scan",
  scanning: ({ scan }) => `scanning: ${scan.done} of ${countOf(scan.due, "new file")} read`,
  ready: () => "up to date",
  offline: () => "offline",
};

/**
 * @param {"rescan" | "confirm"} action
 * @param {string} text
 * @param {Source} source
 * @param {boolean} busy
 */
function act(action, text, { id, name }, busy) {
  const made = button(text, async () => {
    try {
      await (await ask(address(`sources/${id}/${action}`), { method: "POST" })).text();
      openLibrary();
    } catch (error) {
      showError(errorBox, error);
    }
  }, `${text}: ${name}`);
  made.disabled = busy;
  made.dataset.act = `${action} ${id}`;
  return made;
}

/** The list of the files that are there more than once. */
const EQUAL = "equal";

/** One line a shape, with all its files. @param {SourceFile[]} listed Those of one shape together. */
function equalFiles(listed) {
  /** @type {SourceFile[][]} */
  const groups = [];
  for (const file of listed) {
    if (groups.at(-1)?.[0].shape_id === file.shape_id) groups.at(-1)?.push(file);
    else groups.push([file]);
  }
  return groups.map((group) => {
    const [{ shape_id }] = group, paths = group.map(({ path }) => path).join(" = ");
    return make("li", {}, shape_id === null ? paths : make("a", { href: address(`shapes/${shape_id}/view`) }, paths));
  });
}

/**
 * A list of the files in a state, or of equal files, which is loaded when it is opened.
 * @param {string} id
 * @param {string} kind
 * @param {string} title
 */
function files(id, kind, title) {
  const lines = make("ul", { className: "files" });
  const made = make("details", {}, make("summary", {}, title), lines);
  const key = `${kind} ${id}`;
  made.addEventListener("toggle", async () => {
    if (!made.open) open.delete(key);
    if (!made.open) return;
    open.add(key);
    try {
      /** @type {SourceFilePage} */
      const page = await (await ask(address(`sources/${id}/files`, {
        ...(kind === EQUAL ? { equal: "true" } : { state: kind }), limit: String(SHOWN),
      }))).json();
      const rest = page.total - page.files.length;
      const made = kind === EQUAL ? equalFiles(page.files)
        : page.files.map(({ path, problem }) => make("li", {}, problem ? `${path}: ${problem.detail}` : path));
      lines.replaceChildren(
        ...(made.length > 0 ? made : [make("li", {}, "none")]),
        ...(rest > 0 ? [make("li", {}, `and ${rest} more`)] : []),
      );
    } catch (error) {
      showError(errorBox, error);
    }
  });
  made.open = open.has(key);
  return made;
}
