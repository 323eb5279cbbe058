// The stored shapes: filtered, extended by scrolling.

import { address, ask } from "./api.js";
import { deleted, erased } from "./deleted.js";
import { byId, countOf, make, showError } from "./dom.js";
import { showFacets } from "./facets.js";
import { changedIn, fill, parametersOf, showCount } from "./fields.js";
import { locate } from "./paths.js";
import { selectBox, unselect } from "./selection.js";
import { menuButton, shapeCard } from "./shape_card.js";
import { keep } from "./state.js";

/** @import { State } from "./state.js" */
/** @import { Families, Shape, ShapePage } from "./types.js" */

const PAGE = 60;

const list = byId("gallery", HTMLElement);
const status = byId("gallery-status", HTMLElement);
const errorBox = byId("gallery-error", HTMLElement);
const more = byId("gallery-more", HTMLButtonElement);
const form = byId("gallery-form", HTMLFormElement);

let changes = false;
/** The parameters of the current list. @type {string | null} */
let shown = null;
let total = 0;
/** Number of shapes in the list. */
let listed = 0;
/** @type {string | null} */
let cursor = null;
/** Number of the current list; a response for an earlier list is discarded. */
let generation = 0;
let loading = false;
/** The shapes of each chunk of the list. @type {WeakMap<Element, Shape[]>} */
const shapesOf = new WeakMap();
/** The other shapes of a family, by the first. @type {WeakMap<Shape, Shape[]>} */
const othersOf = new WeakMap();

/** The filters, and whether families are shown. */
function asked() {
  const parameters = parametersOf(form);
  const grouped = parameters.has("families");
  parameters.delete("families");
  return { parameters, grouped };
}

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
  showCount(form, byId("gallery-filters", HTMLDetailsElement), byId("gallery-filter-count", HTMLElement));
  generation++;
  cursor = null;
  loading = false;
  listed = 0;
  nearby.disconnect();
  list.replaceChildren();
  showFacets(asked().parameters);
  return load();
}

async function load() {
  if (loading) return;
  loading = true;
  const own = generation;
  const { parameters, grouped } = asked();
  try {
    const page = grouped ? await families(parameters) : await pageOf(parameters);
    if (own !== generation) return;
    showError(errorBox);
    cursor = page.next_cursor;
    total = page.total;
    listed += page.shapes.length;
    for (let i = 0; i < page.shapes.length; i += PAGE) append(page.shapes.slice(i, i + PAGE));
  } catch (error) {
    if (own !== generation) return;
    cursor = null;
    showError(errorBox, error);
  }
  loading = false;
  showTotal();
  // The observer reports changes only: observe again in case the end of the list is still visible.
  watcher.unobserve(more);
  if (cursor) watcher.observe(more);
}

/** The next page of the list. @param {URLSearchParams} parameters @returns {Promise<ShapePage>} */
async function pageOf(parameters) {
  parameters.set("limit", String(PAGE));
  if (cursor) parameters.set("cursor", cursor);
  return (await ask(address("shapes", parameters))).json();
}

/** The first shapes of all families, as one page. @param {URLSearchParams} parameters @returns {Promise<ShapePage>} */
async function families(parameters) {
  parameters.delete("sort");
  /** @type {Families} */
  const found = await (await ask(address("families", parameters))).json();
  const shapes = found.families.map(({ shapes: [first, ...others] }) => {
    othersOf.set(first, others);
    return first;
  });
  return { shapes, total: shapes.length, next_cursor: null };
}

/** @param {Shape[]} shapes */
function append(shapes) {
  const chunk = make("ul", { className: "gallery" });
  show(chunk, shapes);
  list.append(chunk);
  nearby.observe(chunk);
}

function showTotal() {
  more.hidden = cursor === null;
  if (asked().grouped) {
    status.textContent = total === 0 ? "No similar shapes are known." : `${countOf(total, "group")} of similar shapes`;
    return;
  }
  const empty = [...changedIn(form).keys()].some((name) => name !== "sort") ? "No stored shape matches." : "No shapes are stored yet.";
  status.textContent = total === 0 ? empty : `${listed} of ${total} shown`;
}

/**
 * Fill a chunk with cards.
 * @param {HTMLElement} chunk
 * @param {Shape[]} shapes
 */
function show(chunk, shapes) {
  shapesOf.set(chunk, shapes);
  chunk.replaceChildren(...shapes.map((shape) => {
    const card = shapeCard(shape, menuButton(shape, changes ? () => removeShape(shape, chunk) : null));
    card.prepend(selectBox(shape));
    const others = othersOf.get(shape);
    if (others) card.append(make("details", {}, make("summary", {}, `${others.length} more like this`), make("ul", { className: "gallery" }, ...others.map((other) => shapeCard(other)))));
    return card;
  }));
  locate(chunk).catch((error) => showError(errorBox, error));
}

/**
 * Delete a shape and its card.
 * @param {Shape} shape
 * @param {HTMLElement} chunk
 */
async function removeShape(shape, chunk) {
  const own = generation;
  try {
    if (!await erased(shape)) return;
    unselect(shape.id);
    if (own !== generation) {
      // The list that was loaded meanwhile may still have the shape.
      reload();
      deleted(shape);
      return;
    }
    // A far chunk has no cards, and the list of its shapes alone changes.
    const shapes = shapesOf.get(chunk) ?? [];
    const card = chunk.children[shapes.indexOf(shape)];
    const next = card?.nextElementSibling ?? card?.previousElementSibling;
    card?.remove();
    shapesOf.set(chunk, shapes.filter((other) => other !== shape));
    total--;
    listed--;
    showTotal();
    showError(errorBox);
    if (deleted(shape)) return;
    /** @type {HTMLElement | null | undefined} */ (next?.querySelector(".menu"))?.focus();
  } catch (error) {
    showError(errorBox, error);
  }
}

// Far chunks are empty boxes of the same height, so that neither the time of a layout nor the garbage that the
// browser looks through grows with the list.
const nearby = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting, boundingClientRect: { height } } of entries) {
    const chunk = /** @type {HTMLElement} */ (target);
    const isFar = chunk.style.height !== "";
    if (isIntersecting && isFar) {
      chunk.style.height = "";
      show(chunk, shapesOf.get(chunk) ?? []);
    } else if (!isIntersecting && !isFar && height > 0 && !chunk.contains(document.activeElement)) {
      chunk.style.height = `${height}px`;
      chunk.replaceChildren();
    }
  }
}, { rootMargin: "1500px" });

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
