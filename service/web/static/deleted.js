// Deleted shapes: a button restores the last one, a list restores the others.

import { address, ask } from "./api.js";
import { button, byId, countOf, make, showError } from "./dom.js";
import { moment } from "./facts.js";

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

/** @param {{ name: string }[]} shapes */
const nameOf = (shapes) => (shapes.length === 1 ? shapes[0].name : `${shapes.length} shapes`);

/** @param {{ name: string }[]} shapes @param {string} done Such as "deleted". */
const told = (shapes, done) => `${nameOf(shapes)} ${shapes.length === 1 ? "was" : "were"} ${done}.`;

/**
 * Whether the user confirms that shapes are deleted for good.
 * @param {{ name: string }[]} shapes
 */
async function confirmed(shapes) {
  byId("deletion-title", HTMLElement).textContent = shapes.length === 1 ? "Delete this shape?" : "Delete these shapes?";
  const them = shapes.length === 1 ? "it" : "them";
  byId("deletion-text", HTMLElement).textContent = `${nameOf(shapes)} will no longer be found. You cannot restore ${them}.`;
  dialog.returnValue = "cancel";
  dialog.showModal();
  await new Promise((closed) => dialog.addEventListener("close", closed, { once: true }));
  return dialog.returnValue === "delete";
}

/** Whether deleted shapes can be restored for a time. */
export const areKept = () => days > 0;

/** Whether shapes may be deleted, which is asked where they cannot be restored. @param {{ name: string }[]} shapes */
export const mayDelete = async (shapes) => areKept() || await confirmed(shapes);

/**
 * Delete a shape, if that is confirmed where it cannot be restored. Returns whether it is deleted.
 * @param {{ id: string, name: string }} shape
 */
export async function erased(shape) {
  if (!await mayDelete([shape])) return false;
  await ask(address(`shapes/${shape.id}`), { method: "DELETE" });
  return true;
}

/**
 * Offer to undo a deletion; false if the service keeps no deleted shapes.
 * @param {...{ id: string, name: string }} shapes
 */
export function deleted(...shapes) {
  if (!areKept()) return false;
  const undo = undoOf(shapes);
  const time = countOf(days, "day");
  offer.replaceChildren(`${told(shapes, "deleted")} You can restore ${shapes.length === 1 ? "it" : "them"} within ${time}. `, undo);
  // The button is always visible, so the page need not scroll.
  undo.focus({ preventScroll: true });
  recount();
  return true;
}

/** @param {{ id: string, name: string }[]} shapes */
const undoOf = (shapes) => button("Undo", () => restore(shapes), `Undo: restore ${nameOf(shapes)}`);

/** @param {{ id: string, name: string }[]} shapes */
async function restore(shapes) {
  /** @type {typeof shapes} */
  const back = [];
  try {
    for (const shape of shapes) {
      await (await ask(address(`shapes/${shape.id}/restore`), { method: "POST" })).text();
      back.push(shape);
    }
    showError(errorBox);
    offer.replaceChildren(told(shapes, "restored"));
    offer.focus({ preventScroll: true });
  } catch (error) {
    showError(errorBox, error);
    // The rest can be restored by another press.
    const rest = shapes.filter((shape) => !back.includes(shape));
    if (back.length > 0) offer.replaceChildren(told(back, "restored"), " ", undoOf(rest));
  }
  if (back.length > 0) restored();
  await recount();
}

/** Erase a deleted shape, if that is confirmed. @param {DeletedShape} shape */
async function erase({ id, name }) {
  if (!await confirmed([{ name }])) return;
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
  make("span", {}, "Deleted ", marked(shape.deleted_at), ", can be restored until ", marked(shape.gone_at)),
  make(
    "div", { className: "buttons" },
    button("Restore", () => restore([shape]), `Restore ${shape.name}`),
    button("Delete for good", () => erase(shape), `Delete ${shape.name} for good`),
  ),
);

/** @param {string} time */
const marked = (time) => make("time", { dateTime: time }, moment(time));

box.addEventListener("toggle", () => {
  if (box.open) recount();
});
more.addEventListener("click", append);
