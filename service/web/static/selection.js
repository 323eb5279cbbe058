// The selected shapes of the list: tag, move, delete or export all of them.

import { address, ask, changeShape, collection, collections, readShape, version } from "./api.js";
import { deleted, mayDelete } from "./deleted.js";
import { button, byId, countOf, make, messageOf } from "./dom.js";
import { parametersOf, tagsIn } from "./fields.js";

/** @import { Families, Shape, ShapePage, Suggestions } from "./types.js" */

/** Requests that run at a time; failures, or names of shapes, that are told. */
const AT_ONCE = 2, TOLD = 5;
const PAGE = "500";

const bar = byId("selection", HTMLFormElement);
const status = byId("selection-status", HTMLElement);
const tags = byId("selection-tags", HTMLInputElement);
const target = byId("selection-collection", HTMLSelectElement);
const format = byId("selection-format", HTMLSelectElement);
const suggested = byId("selection-suggested", HTMLUListElement);

/** @type {Map<string, Shape>} */
const selected = new Map();
/** Called after shapes have changed. */
let changed = () => {};

/** @param {() => void} onChanged Called after shapes have changed. */
export const openSelection = (onChanged) => (changed = onChanged);

/** The box that selects a shape. @param {Shape} shape */
export function selectBox(shape) {
  const box = make("input", { type: "checkbox", className: "select", checked: selected.has(shape.id), ariaLabel: `Select ${shape.name}` });
  box.dataset.select = shape.id;
  box.addEventListener("change", () => {
    if (box.checked) selected.set(shape.id, shape);
    else selected.delete(shape.id);
    clear();
  });
  return box;
}

/** @param {string} id */
export function unselect(id) {
  selected.delete(id);
  show();
}

/** Tell no longer what was done. */
export function forget() {
  status.textContent = "";
  show();
}

/** Show another selection, of which nothing is told yet. */
function clear() {
  suggested.replaceChildren();
  forget();
}

/** Show how many are selected, and their boxes. */
function show() {
  if (selected.size > 0 && bar.hidden) offer();
  bar.hidden = selected.size === 0 && status.textContent === "";
  byId("selection-count", HTMLElement).textContent = `${selected.size} selected`;
  for (const box of document.querySelectorAll("[data-select]")) {
    const { dataset } = /** @type {HTMLInputElement} */ (box);
    /** @type {HTMLInputElement} */ (box).checked = selected.has(dataset.select ?? "");
  }
}

/** Fill the choices of collections and of formats. */
async function offer() {
  const [others, { formats }] = await Promise.all([collections(), version()]);
  target.replaceChildren(...others.filter(({ name }) => name !== (collection || "default")).map(({ name }) => make("option", {}, name)));
  byId("selection-move", HTMLElement).hidden = target.options.length === 0;
  if (format.options.length === 1) {
    format.append(...formats.filter(({ written }) => written).map(({ name, title }) => make("option", { value: name }, title)));
  }
}

/**
 * Do something with each of some shapes; those that fail stay selected, and the reasons are told.
 * @param {string} done Such as "tagged".
 * @param {(shape: Shape) => Promise<unknown>} work
 * @param {Shape[]} shapes
 * @returns {Promise<Shape[]>} The shapes of which it is done.
 */
async function each(done, work, shapes = [...selected.values()]) {
  const waiting = [...shapes], total = waiting.length;
  /** @type {Shape[]} */
  const finished = [];
  /** @type {string[]} */
  const failures = [];
  const controls = byId("selection-controls", HTMLFieldSetElement);
  controls.disabled = true;
  const next = async () => {
    for (let shape = waiting.shift(); shape; shape = waiting.shift()) {
      try {
        await work(shape);
        finished.push(shape);
      } catch (error) {
        failures.push(`${shape.name}: ${messageOf(error)}`);
      }
      status.textContent = `${finished.length} of ${total} ${done}`;
    }
  };
  await Promise.all(Array.from({ length: AT_ONCE }, next));
  controls.disabled = false;
  const told = failures.slice(0, TOLD).map((failure) => ` ${failure}`).join("");
  const more = failures.length > TOLD ? ` And ${failures.length - TOLD} more.` : "";
  status.textContent = `${countOf(finished.length, "shape")} ${done}.`
    + (failures.length > 0 ? ` ${failures.length} not:${told}${more}` : "");
  return finished;
}

/** Leave the shapes that are gone out of the selection, and show the list anew. @param {Shape[]} [gone] */
function finish(gone = []) {
  for (const { id } of gone) selected.delete(id);
  show();
  changed();
}

/** Change the tags of a selected shape, which may be newer than the list. @param {string} id @param {(own: string[]) => string[]} change */
const changeTags = async (id, change) => selected.set(id, await changeShape(id, { tags: change((await readShape(id)).tags) }));

/** @param {string} id @param {string[]} given */
const addTags = (id, given) => changeTags(id, (own) => [...new Set([...own, ...given])]);

/** @param {string} done @param {(id: string, given: string[]) => Promise<unknown>} change */
async function retag(done, change) {
  const given = tagsIn(tags.value);
  if (given.length === 0) return tags.focus();
  await each(done, ({ id }) => change(id, given));
  tags.value = "";
  finish();
}

/** Show the tags that shapes like the selected ones have and these lack, those of most shapes first; a person adds each. */
async function suggest() {
  /** @type {Map<string, Shape[]>} */
  const lacking = new Map();
  let unknown = 0;
  await each("compared", async (shape) => {
    /** @type {Suggestions} */
    const { suggestions, known } = await (await ask(address(`shapes/${shape.id}/suggestions`))).json();
    if (!known) unknown += 1;
    for (const { key, value } of suggestions) {
      if (key === null) lacking.set(String(value), [...lacking.get(String(value)) ?? [], shape]);
    }
  });
  if (lacking.size === 0) status.textContent += " No tags are suggested.";
  if (unknown > 0) status.textContent += ` Shapes similar to ${unknown} of them are not known yet.`;
  const byCount = [...lacking].sort(([, one], [, other]) => other.length - one.length);
  suggested.replaceChildren(...byCount.map(([tag, shapes]) => {
    const names = shapes.map(({ name }) => name).sort().slice(0, TOLD).join(", ");
    const more = shapes.length > TOLD ? ` and ${shapes.length - TOLD} more` : "";
    const row = make("li", {}, button("Add", accept, `Add ${tag}`), ` ${tag}, to ${names}${more}`);
    async function accept() {
      await each("tagged", ({ id }) => addTags(id, [tag]), shapes);
      row.remove();
      finish();
    }
    return row;
  }));
}

/** The shapes of all pages of the list. @param {URLSearchParams} wanted @returns {AsyncGenerator<Shape>} */
async function* inPages(wanted) {
  wanted.set("limit", PAGE);
  do {
    /** @type {ShapePage} */
    const page = await (await ask(address("shapes", wanted))).json();
    yield* page.shapes;
    wanted.set("cursor", page.next_cursor ?? "");
  } while (wanted.get("cursor"));
}

/** The shapes of all groups of the list. @param {URLSearchParams} wanted @returns {AsyncGenerator<Shape>} */
async function* inFamilies(wanted) {
  for (const name of ["families", "sort"]) wanted.delete(name);
  /** @type {Families} */
  const { families } = await (await ask(address("families", wanted))).json();
  yield* families.flatMap(({ shapes }) => shapes);
}

/** @type {Record<string, () => Promise<void> | void>} */
const ACTIONS = {
  all: async () => {
    const wanted = parametersOf(byId("gallery-form", HTMLFormElement));
    for await (const shape of wanted.has("families") ? inFamilies(wanted) : inPages(wanted)) selected.set(shape.id, shape);
    clear();
  },
  none: () => {
    selected.clear();
    clear();
  },
  tag: () => retag("tagged", addTags),
  untag: () => retag("untagged", (id, given) => changeTags(id, (own) => own.filter((tag) => !given.includes(tag)))),
  suggest,
  move: async () => finish(await each(`moved to ${target.value}`, ({ id }) => changeShape(id, { collection: target.value }))),
  delete: async () => {
    if (!await mayDelete([...selected.values()])) return;
    const gone = await each("deleted", ({ id }) => ask(address(`shapes/${id}`), { method: "DELETE" }));
    finish(gone);
    if (gone.length > 0) deleted(...gone);
  },
  // What writes files is loaded with the first export.
  table: async () => (await import("./csv.js")).saveTable("shapes.csv", table([...selected.values()])),
  files: async () => {
    /** @type {Map<string, ArrayBuffer>} */
    const files = new Map();
    await each("read", async ({ id }) => {
      const answer = await ask(address(`shapes/${id}/file`, { format: format.value }));
      files.set(freeName(nameIn(answer.headers.get("Content-Disposition") ?? ""), files), await answer.arrayBuffer());
    });
    const { save, zip } = await import("./zip.js");
    if (files.size > 0) save("shapes.zip", await zip([...files].map(([name, data]) => ({ name, data }))));
  },
};

/** The name of a file, with folders, in a header of the service. @param {string} disposition */
const nameIn = (disposition) => decodeURIComponent(disposition.split("filename*=UTF-8''")[1] ?? "file")
  .split(/[\\/]/).filter((part) => !/^\.*$/.test(part)).join("/");

/** @param {string} name @param {Map<string, unknown>} taken */
function freeName(name, taken) {
  const [, stem, ending] = /** @type {RegExpExecArray} */ (/^(.*?)(\.[^./]*)?$/s.exec(name));
  let free = name;
  for (let number = 2; taken.has(free); number++) free = `${stem} (${number})${ending ?? ""}`;
  return free;
}

/** @param {Shape[]} shapes */
function table(shapes) {
  const keys = [...new Set(shapes.flatMap(({ metadata }) => Object.keys(metadata)))].sort();
  const head = [
    "id", "name", "tags", "format", "bytes", "sha256", "created_at", "updated_at", "unit", "length", "width", "height",
    "x", "y", "z", "area", "volume", "vertices", "faces", ...keys.map((key) => `metadata.${key}`),
  ];
  return [head, ...shapes.map(({ id, name, tags: own, format: kind, bytes, sha256, created_at, updated_at, unit, facts, metadata }) => [
    id, name, own.join(", "), kind, bytes, sha256, created_at, updated_at, unit, ...facts.bounding_box, ...facts.file_box,
    facts.area, facts.closed ? facts.volume : null, facts.vertices, facts.faces,
    ...keys.map((key) => cellOf(metadata[key])),
  ])];
}

/** @param {unknown} value */
const cellOf = (value) => value === undefined ? null : typeof value === "string" || typeof value === "number" ? value : JSON.stringify(value);

/** @param {string} action */
async function act(action) {
  try {
    await ACTIONS[action]();
  } catch (error) {
    status.textContent = messageOf(error);
  }
}

bar.addEventListener("submit", (event) => {
  event.preventDefault();
  act(/** @type {HTMLButtonElement} */ (event.submitter).value);
});
for (const own of bar.querySelectorAll("button[type=button]")) {
  own.addEventListener("click", () => act(/** @type {HTMLButtonElement} */ (own).value));
}
