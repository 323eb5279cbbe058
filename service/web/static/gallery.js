// The stored shapes: searched by name and tag, more as one scrolls, and deleted.

import { address, ask } from "./api.js";
import { deleted, fate } from "./deleted.js";
import { button, byId, listed, make, showTrouble } from "./dom.js";
import { findStored } from "./find.js";

/** @import { Shape, ShapePage } from "./types.js" */

const PAGE = "60";

const list = byId("gallery", HTMLUListElement);
const told = byId("gallery-told", HTMLElement);
const trouble = byId("gallery-trouble", HTMLElement);
const more = byId("gallery-more", HTMLButtonElement);
const named = byId("gallery-name", HTMLInputElement);
const tagged = byId("gallery-tags", HTMLInputElement);
const known = byId("tags", HTMLDataListElement);
const dialog = byId("deletion", HTMLDialogElement);

let changes = false;
let total = 0;
/** @type {string | null} */
let cursor = null;
/** Counted up when another list is asked for, so that an answer for the old one is dropped. */
let turn = 0;
let loading = false;

/** @param {boolean} mayChange Whether shapes may be deleted. */
export function openGallery(mayChange) {
  changes = mayChange;
  return reload();
}

/** Show the list anew. */
export function reload() {
  turn++;
  cursor = null;
  loading = false;
  list.replaceChildren();
  return load();
}

async function load() {
  if (loading) return;
  loading = true;
  const own = turn;
  const wanted = { limit: PAGE, name: named.value.trim(), tag: listed(tagged.value), cursor: cursor ?? "" };
  try {
    /** @type {ShapePage} */
    const page = await (await ask(address("shapes", wanted))).json();
    if (own !== turn) return;
    showTrouble(trouble);
    cursor = page.next_cursor;
    total = page.total;
    list.append(...page.shapes.map(item));
    for (const shape of page.shapes) shape.tags.forEach(knowTag);
  } catch (error) {
    if (own !== turn) return;
    cursor = null;
    showTrouble(trouble, error);
  }
  loading = false;
  tell();
  // Where the new ones do not fill the window, the end is still in sight and nothing would tell of it.
  watcher.unobserve(more);
  if (cursor) watcher.observe(more);
}

function tell() {
  more.hidden = cursor === null;
  const empty = named.value || tagged.value ? "No stored shape is meant." : "Nothing is stored yet.";
  told.textContent = total === 0 ? empty : `${list.children.length} of ${total} shown`;
}

/** @param {Shape} shape */
function item(shape) {
  const picture = make("img", {
    src: address(`shapes/${shape.id}/thumbnail.png`), alt: "", loading: "lazy", decoding: "async", width: 256, height: 256,
  });
  // A service that is busy answers again in a while.
  picture.addEventListener("error", () => setTimeout(() => (picture.src = picture.src), 3000), { once: true });
  const tags = shape.tags.map((tag) => button(tag, () => {
    tagged.value = tag;
    reload();
  }, `Only shapes tagged ${tag}`));
  const made = make(
    "li", {},
    picture,
    make("a", { className: "name", href: address(`shapes/${shape.id}/view`) }, shape.name),
    make("div", { className: "tags" }, ...tags),
    make("div", { className: "buttons" },
      button("Find alike", () => findStored(shape.id, shape.name), `Find shapes like ${shape.name}`),
      ...(changes ? [button("Delete", () => remove(shape, made), `Delete ${shape.name}`)] : [])),
  );
  return made;
}

/** @param {string} tag */
function knowTag(tag) {
  if (![...known.options].some((option) => option.value === tag)) known.append(make("option", { value: tag }));
}

/**
 * Ask, and then delete.
 * @param {Shape} shape
 * @param {HTMLLIElement} own
 */
async function remove(shape, own) {
  byId("deletion-text", HTMLElement).textContent = `${shape.name} will be gone from every answer. ${fate()}`;
  dialog.returnValue = "keep";
  dialog.showModal();
  await new Promise((closed) => dialog.addEventListener("close", closed, { once: true }));
  if (dialog.returnValue !== "delete") return;
  try {
    await ask(address(`shapes/${shape.id}`), { method: "DELETE" });
    const next = own.nextElementSibling ?? own.previousElementSibling;
    own.remove();
    total--;
    tell();
    showTrouble(trouble);
    if (deleted(shape)) return;
    /** @type {HTMLElement | null | undefined} */ (next?.querySelector(".buttons button:last-child"))?.focus();
  } catch (error) {
    showTrouble(trouble, error);
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
