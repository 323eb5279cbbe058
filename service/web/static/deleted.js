// Deleted shapes: a button restores the last one, a list restores the others.

import { address, ask } from "./api.js";
import { button, byId, make, showError } from "./dom.js";

/** @import { DeletedPage, DeletedShape } from "./types.js" */

const SHOWN = 60;

const offer = byId("undo", HTMLElement);
const box = byId("deleted", HTMLDetailsElement);
const count = byId("deleted-count", HTMLElement);
const list = byId("deleted-list", HTMLUListElement);
const more = byId("deleted-more", HTMLButtonElement);
const errorBox = byId("gallery-error", HTMLElement);
const dialog = byId("deletion", HTMLDialogElement);

/** Number of days in which a deleted shape can be restored. */
let days = 0;
/** Called after a shape is restored. */
let restored = () => {};
/** @type {DeletedShape[]} The latest deletion comes first. */
let all = [];

/** @param {() => void} onRestored Called after a shape is restored. */
export async function openDeleted(onRestored) {
  restored = onRestored;
  await recount();
}

/**
 * Whether the user confirms that a shape is deleted for good.
 * @param {string} name
 */
async function confirmed(name) {
  byId("deletion-text", HTMLElement).textContent = `${name} will no longer be found. You cannot restore it.`;
  dialog.returnValue = "cancel";
  dialog.showModal();
  await new Promise((closed) => dialog.addEventListener("close", closed, { once: true }));
  return dialog.returnValue === "delete";
}

/**
 * Delete a shape, if that is confirmed where it cannot be restored. Returns whether it is deleted.
 * @param {{ id: string, name: string }} shape
 */
export async function erased({ id, name }) {
  if (days === 0 && !await confirmed(name)) return false;
  await ask(address(`shapes/${id}`), { method: "DELETE" });
  return true;
}

/**
 * Offer to undo a deletion; false if the service keeps no deleted shapes.
 * @param {{ id: string, name: string }} shape
 */
export function deleted(shape) {
  if (days === 0) return false;
  const undo = button("Undo", () => restore(shape), `Undo: restore ${shape.name}`);
  const time = days === 1 ? "one day" : `${days} days`;
  offer.replaceChildren(`${shape.name} was deleted. You can restore it within ${time}. `, undo);
  // The button is always visible, so the page need not scroll.
  undo.focus({ preventScroll: true });
  recount();
  return true;
}

/** @param {{ id: string, name: string }} shape */
async function restore(shape) {
  try {
    await (await ask(address(`shapes/${shape.id}/restore`), { method: "POST" })).text();
    showError(errorBox);
    offer.replaceChildren(`${shape.name} was restored.`);
    offer.focus({ preventScroll: true });
    restored();
  } catch (error) {
    showError(errorBox, error);
  }
  await recount();
}

/** Erase a deleted shape, if that is confirmed. @param {DeletedShape} shape */
async function erase({ id, name }) {
  if (!await confirmed(name)) return;
  try {
    await ask(address(`deleted/${id}`), { method: "DELETE" });
    showError(errorBox);
    offer.replaceChildren(`${name} was deleted for good.`);
    offer.focus({ preventScroll: true });
  } catch (error) {
    showError(errorBox, error);
  }
  await recount();
}

/** Update the number of deleted shapes, and their list if it is open. */
async function recount() {
  try {
    const { total, undo_days } = await page({ limit: "1" });
    days = undo_days;
    box.hidden = total === 0;
    count.textContent = String(total);
    if (box.open) await show();
  } catch (error) {
    showError(errorBox, error);
  }
}

async function show() {
  /** @type {DeletedShape[]} */
  const found = [];
  let cursor = "";
  do {
    const next = await page({ limit: "500", cursor });
    found.push(...next.shapes);
    cursor = next.next_cursor ?? "";
  } while (cursor);
  all = found.reverse();
  list.replaceChildren();
  append();
}

/**
 * @param {Record<string, string>} wanted
 * @returns {Promise<DeletedPage>}
 */
const page = async (wanted) => (await ask(address("deleted", wanted))).json();

function append() {
  const from = list.children.length;
  list.append(...all.slice(from, from + SHOWN).map(line));
  more.hidden = list.children.length >= all.length;
}

/** @param {DeletedShape} shape */
const line = (shape) => make(
  "li", {},
  make("span", { className: "name" }, shape.name),
  make("span", {}, "Deleted ", moment(shape.deleted_at), ", can be restored until ", moment(shape.gone_at)),
  make(
    "div", { className: "buttons" },
    button("Restore", () => restore(shape), `Restore ${shape.name}`),
    button("Delete for good", () => erase(shape), `Delete ${shape.name} for good`),
  ),
);

/** @param {string} time */
const moment = (time) => make("time", { dateTime: time }, new Date(time).toLocaleString());

box.addEventListener("toggle", () => {
  if (box.open) recount();
});
more.addEventListener("click", append);
