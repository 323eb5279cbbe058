// The page of a stored shape: in 3D, its record, its file in any format, and its text, which can be edited.

import { address, ask, changeShape, collection, readShape, session, version } from "./api.js";
import { card } from "./card.js";
import { showSingle, storedGlb } from "./comparison.js";
import { button, byId, make, showError } from "./dom.js";
import { measures, moment, textOf } from "./facts.js";
import { tagsIn } from "./fields.js";
import { readGlb } from "./glb.js";
import { showSuggestions } from "./suggestions.js";

/** @import { Shape, Source, SourceFilePage, Version } from "./types.js" */

const form = byId("edit", HTMLFormElement);
const open = byId("edit-open", HTMLButtonElement);
const rows = byId("edit-metadata", HTMLElement);
const errorBox = byId("edit-error", HTMLElement);

const { canvas, item, retitle } = card("", [], null);

/** @type {Shape} */
let shape;

/** @param {string} id */
export async function showShape(id) {
  const [read, { access }, { formats }] = await Promise.all([readShape(id), session(), version()]);
  showRecord(read);
  offerDownload(formats);
  byId("similar", HTMLAnchorElement).href = address("", { shape_id: id });
  byId("about", HTMLElement).hidden = false;
  open.hidden = byId("library", HTMLElement).hidden = access !== "full";
  if (access === "full") {
    suggest();
    showPaths(id).catch((error) => showError(errorBox, error));
  }
  byId("cards", HTMLElement).append(item);
  showSingle(canvas, readGlb(await storedGlb(id)));
}

/** @param {Shape} read */
function showRecord(read) {
  shape = read;
  const { name, tags, metadata, format, bytes, created_at, updated_at } = shape;
  byId("title", HTMLElement).textContent = document.title = name;
  retitle(name);
  byId("shape-tags", HTMLElement).replaceChildren(...tags.map((tag) => make("a", { href: address("", { view: "browse", tag }) }, tag)));
  list("facts", [
    ...measures(shape, null),
    ["file", `${format.toUpperCase()}, ${Math.ceil(bytes / 1000).toLocaleString("en")} kB`],
    ["collection", collection || "default"],
    ["stored", moment(created_at)],
    ["changed", moment(updated_at)],
  ]);
  list("metadata", Object.entries(metadata).map(([key, value]) => [key, textOf(value)]));
}

/** Show where the shape is in the library. @param {string} id */
async function showPaths(id) {
  /** @type {{ sources: Source[] }} */
  const { sources } = await (await ask(address("sources"))).json();
  const found = await Promise.all(sources.map(async ({ id: source, path: folder }) => {
    /** @type {SourceFilePage} */
    const { files } = await (await ask(address(`sources/${source}/files`, { shape_id: id }))).json();
    return files.map(({ path, state }) => `${folder}/${path}${state === "present" ? "" : ` (${state})`}`);
  }));
  list("paths", found.flat().map((path) => ["in the library", path]));
}

/** Show what similar shapes have and this one lacks. */
const suggest = () => showSuggestions(shape.id, async ({ key, value }) => {
  const { tags, metadata } = shape;
  const entry = key === null ? { tags: [...tags, textOf(value)] } : { metadata: { ...metadata, [key]: value } };
  showRecord(await changeShape(shape.id, entry));
  await suggest();
});

/** @param {string} id Of a list of terms. @param {[string, string][]} entries */
const list = (id, entries) => byId(id, HTMLElement).replaceChildren(
  ...entries.flatMap(([term, value]) => [make("dt", {}, term), make("dd", {}, value)]),
);

/** @param {Version["formats"]} formats */
function offerDownload(formats) {
  const choice = byId("format", HTMLSelectElement), link = byId("download", HTMLAnchorElement);
  choice.replaceChildren(
    make("option", { value: "" }, `${shape.format.toUpperCase()}, as stored`),
    ...formats.filter(({ name, written }) => written && name !== shape.format).map(({ name, title }) => make("option", { value: name }, title)),
  );
  const point = () => (link.href = address(`shapes/${shape.id}/file`, { format: choice.value }));
  choice.addEventListener("change", point);
  point();
}

/** The value of an edited text. @param {string} text @param {unknown} before */
function valueOf(text, before) {
  if (before !== undefined && text === textOf(before)) return before;
  try {
    const value = JSON.parse(text);
    return typeof value === "string" ? text : value;
  } catch {
    return text;
  }
}

/** Add the fields of an entry of the metadata. @param {string} key @param {unknown} [value] */
function addRow(key, value) {
  const first = make("input", { type: "text", value: key, ariaLabel: "Key", autocomplete: "off" });
  const second = make("input", { type: "text", value: value === undefined ? "" : textOf(value), ariaLabel: "Value", autocomplete: "off" });
  const row = make("div", { className: "buttons" }, first, second, button("Remove", () => row.remove(), `Remove ${key || "this entry"}`));
  rows.append(row);
  return first;
}

/** The edited metadata. */
function metadataOf() {
  /** @type {[string, unknown][]} */
  const entries = [...rows.children].map((row) => {
    const [key, value] = [...row.querySelectorAll("input")].map((field) => field.value);
    return [key.trim(), valueOf(value, shape.metadata[key.trim()])];
  });
  return Object.fromEntries(entries.filter(([key]) => key !== ""));
}

open.addEventListener("click", () => {
  byId("edit-name", HTMLInputElement).value = shape.name;
  byId("edit-tags", HTMLInputElement).value = shape.tags.join(", ");
  rows.replaceChildren();
  for (const [key, value] of Object.entries(shape.metadata)) addRow(key, value);
  showError(errorBox);
  form.hidden = false;
  byId("edit-name", HTMLInputElement).focus();
});
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  try {
    showRecord(await changeShape(shape.id, {
      name: byId("edit-name", HTMLInputElement).value,
      tags: tagsIn(byId("edit-tags", HTMLInputElement).value),
      metadata: metadataOf(),
    }));
    close();
  } catch (error) {
    showError(errorBox, error);
  }
});
function close() {
  form.hidden = true;
  open.focus();
}
byId("edit-cancel", HTMLButtonElement).addEventListener("click", close);
byId("edit-add", HTMLButtonElement).addEventListener("click", () => addRow("").focus());
