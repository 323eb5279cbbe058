// The stored shapes: filtered, extended by scrolling.

import { address, ask } from "./api.js";
import { deleted, restorePeriod } from "./deleted.js";
import { button, byId, showError } from "./dom.js";
import { changedIn, fill, parametersOf } from "./fields.js";
import { shapeCard } from "./shape_card.js";
import { keep } from "./state.js";

/** @import { State } from "./state.js" */
/** @import { Shape, ShapePage } from "./types.js" */

const PAGE = "60";

const list = byId("gallery", HTMLUListElement);
const status = byId("gallery-status", HTMLElement);
const errorBox = byId("gallery-error", HTMLElement);
const more = byId("gallery-more", HTMLButtonElement);
const form = byId("gallery-form", HTMLFormElement);
const dialog = byId("deletion", HTMLDialogElement);

let changes = false;
/** The parameters of the current list. @type {string | null} */
let shown = null;
let total = 0;
/** @type {string | null} */
let cursor = null;
/** Number of the current list; a response for an earlier list is discarded. */
let generation = 0;
let loading = false;

/** @param {boolean} mayChange Whether shapes may be deleted. */
export const allowChanges = (mayChange) => (changes = mayChange);

/**
 * Show the list of the address.
 * @param {State} state
 */
export function openGallery({ parameters }) {
  fill(form, parameters);
  const wanted = parametersOf(form).toString();
  if (wanted !== shown) reload();
}

/** Reload the list. */
export function reload() {
  shown = parametersOf(form).toString();
  generation++;
  cursor = null;
  loading = false;
  list.replaceChildren();
  return load();
}

async function load() {
  if (loading) return;
  loading = true;
  const own = generation;
  const wanted = parametersOf(form);
  wanted.set("limit", PAGE);
  if (cursor) wanted.set("cursor", cursor);
  try {
    /** @type {ShapePage} */
    const page = await (await ask(address("shapes", wanted))).json();
    if (own !== generation) return;
    showError(errorBox);
    cursor = page.next_cursor;
    total = page.total;
    list.append(...page.shapes.map(item));
  } catch (error) {
    if (own !== generation) return;
    cursor = null;
    showError(errorBox, error);
  }
  loading = false;
  showCount();
  // The observer reports changes only: observe again in case the end of the list is still visible.
  watcher.unobserve(more);
  if (cursor) watcher.observe(more);
}

function showCount() {
  more.hidden = cursor === null;
  const empty = changedIn(form).size > 0 ? "No stored shape matches." : "No shapes are stored yet.";
  status.textContent = total === 0 ? empty : `${list.children.length} of ${total} shown`;
}

/** @param {Shape} shape */
function item(shape) {
  const own = button("Delete", () => removeShape(shape, made), `Delete ${shape.name}`);
  const made = shapeCard(shape, ...(changes ? [own] : []));
  return made;
}

/**
 * Ask for confirmation, then delete.
 * @param {Shape} shape
 * @param {HTMLLIElement} own
 */
async function removeShape(shape, own) {
  byId("deletion-text", HTMLElement).textContent = `${shape.name} will no longer be found. ${restorePeriod()}`;
  dialog.returnValue = "cancel";
  dialog.showModal();
  await new Promise((closed) => dialog.addEventListener("close", closed, { once: true }));
  if (dialog.returnValue !== "delete") return;
  try {
    await ask(address(`shapes/${shape.id}`), { method: "DELETE" });
    const next = own.nextElementSibling ?? own.previousElementSibling;
    own.remove();
    total--;
    showCount();
    showError(errorBox);
    if (deleted(shape)) return;
    /** @type {HTMLElement | null | undefined} */ (next?.querySelector(".buttons button:last-child"))?.focus();
  } catch (error) {
    showError(errorBox, error);
  }
}

const watcher = new IntersectionObserver((entries) => {
  if (cursor && entries.some((entry) => entry.isIntersecting)) load();
}, { rootMargin: "800px" });

let typing = 0;
form.addEventListener("input", () => {
  clearTimeout(typing);
  typing = setTimeout(() => {
    keep(changedIn(form));
    reload();
  }, 250);
});
more.addEventListener("click", load);
form.addEventListener("submit", (event) => event.preventDefault());
