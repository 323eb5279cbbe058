// The list of stored shapes: filtered by name and tag, extended by scrolling.

import { address, ask } from "./api.js";
import { deleted, restorePeriod } from "./deleted.js";
import { button, byId, make, showError, splitList } from "./dom.js";
import { findStored } from "./find.js";

/** @import { Shape, ShapePage } from "./types.js" */

const PAGE = "60";

const list = byId("gallery", HTMLUListElement);
const status = byId("gallery-status", HTMLElement);
const errorBox = byId("gallery-error", HTMLElement);
const more = byId("gallery-more", HTMLButtonElement);
const named = byId("gallery-name", HTMLInputElement);
const tagged = byId("gallery-tags", HTMLInputElement);
const known = byId("tags", HTMLDataListElement);
const dialog = byId("deletion", HTMLDialogElement);

let changes = false;
let total = 0;
/** @type {string | null} */
let cursor = null;
/** Number of the current list; a response for an earlier list is discarded. */
let generation = 0;
let loading = false;

/** @param {boolean} mayChange Whether shapes may be deleted. */
export function openGallery(mayChange) {
  changes = mayChange;
  return reload();
}

/** Reload the list. */
export function reload() {
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
  const wanted = { limit: PAGE, name: named.value.trim(), tag: splitList(tagged.value), cursor: cursor ?? "" };
  try {
    /** @type {ShapePage} */
    const page = await (await ask(address("shapes", wanted))).json();
    if (own !== generation) return;
    showError(errorBox);
    cursor = page.next_cursor;
    total = page.total;
    list.append(...page.shapes.map(item));
    for (const shape of page.shapes) shape.tags.forEach(addTag);
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
  const empty = named.value || tagged.value ? "No stored shape matches." : "No shapes are stored yet.";
  status.textContent = total === 0 ? empty : `${list.children.length} of ${total} shown`;
}

/** @param {Shape} shape */
function item(shape) {
  const picture = make("img", {
    src: address(`shapes/${shape.id}/thumbnail.png`), alt: "", loading: "lazy", decoding: "async", width: 256, height: 256,
  });
  // A busy service may refuse; try again once after three seconds.
  picture.addEventListener("error", () => setTimeout(() => (picture.src = picture.src), 3000), { once: true });
  const tags = shape.tags.map((tag) => button(tag, () => {
    tagged.value = tag;
    reload();
  }, `Show only shapes with the tag ${tag}`));
  const made = make(
    "li", {},
    picture,
    make("a", { className: "name", href: address(`shapes/${shape.id}/view`) }, shape.name),
    make("div", { className: "tags" }, ...tags),
    make("div", { className: "buttons" },
      button("Find similar", () => findStored(shape.id, shape.name), `Find similar to ${shape.name}`),
      ...(changes ? [button("Delete", () => remove(shape, made), `Delete ${shape.name}`)] : [])),
  );
  return made;
}

/** @param {string} tag */
function addTag(tag) {
  if (![...known.options].some((option) => option.value === tag)) known.append(make("option", { value: tag }));
}

/**
 * Ask for confirmation, then delete.
 * @param {Shape} shape
 * @param {HTMLLIElement} own
 */
async function remove(shape, own) {
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
for (const field of [named, tagged]) {
  field.addEventListener("input", () => {
    clearTimeout(typing);
    typing = setTimeout(reload, 250);
  });
}
more.addEventListener("click", load);
byId("gallery-form", HTMLFormElement).addEventListener("submit", (event) => {
  event.preventDefault();
  reload();
});
