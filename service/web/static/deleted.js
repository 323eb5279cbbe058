// What was deleted and can be restored: the last one by a button, the others from a list.

import { address, ask } from "./api.js";
import { button, byId, make, showTrouble } from "./dom.js";

/** @import { DeletedPage, DeletedShape } from "./types.js" */

const SHOWN = 60;

const offer = byId("undo", HTMLElement);
const box = byId("deleted", HTMLDetailsElement);
const count = byId("deleted-count", HTMLElement);
const list = byId("deleted-list", HTMLUListElement);
const more = byId("deleted-more", HTMLButtonElement);
const trouble = byId("gallery-trouble", HTMLElement);

/** How many days a deleted shape can be restored. */
let days = 0;
/** Told when a shape was restored. */
let restored = () => {};
/** @type {DeletedShape[]} The latest first. */
let all = [];

/** @param {() => void} told Told when a shape was restored. */
export async function openDeleted(told) {
  restored = told;
  await recount();
}

/** What becomes of a shape that is deleted. */
export const fate = () => days > 0
  ? `It can be restored for ${days === 1 ? "a day" : `${days} days`}.`
  : "It is gone for good.";

/**
 * Offer to undo a deletion; whether it can be.
 * @param {{ id: string, name: string }} shape
 */
export function deleted(shape) {
  if (days === 0) return false;
  const undo = button("Undo", () => restore(shape), `Undo: restore ${shape.name}`);
  offer.replaceChildren(`${shape.name} is deleted. `, undo);
  // It stays in sight, wherever the page is scrolled to.
  undo.focus({ preventScroll: true });
  recount();
  return true;
}

/** @param {{ id: string, name: string }} shape */
async function restore(shape) {
  try {
    await ask(address(`shapes/${shape.id}/restore`), { method: "POST" });
    showTrouble(trouble);
    offer.replaceChildren(`${shape.name} is stored again, and stands last.`);
    offer.focus({ preventScroll: true });
    restored();
  } catch (error) {
    showTrouble(trouble, error);
  }
  await recount();
}

/** Show how many there are, and them where they are looked at. */
async function recount() {
  try {
    const { total, undo_days } = await page({ limit: "1" });
    days = undo_days;
    box.hidden = total === 0;
    count.textContent = String(total);
    if (box.open) await show();
  } catch (error) {
    showTrouble(trouble, error);
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
  make("span", {}, "deleted ", moment(shape.deleted_at), ", gone for good ", moment(shape.gone_at)),
  button("Restore", () => restore(shape), `Restore ${shape.name}`),
);

/** @param {string} time */
const moment = (time) => make("time", { dateTime: time }, new Date(time).toLocaleString());

box.addEventListener("toggle", () => {
  if (box.open) recount();
});
more.addEventListener("click", append);
