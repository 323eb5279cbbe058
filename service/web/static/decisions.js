// Decisions on groups of duplicates, and merges of them, by buttons and keys. The last one can be undone.

import { address, ask, askWith } from "./api.js";
import { mayDelete } from "./deleted.js";
import { button, make } from "./dom.js";

/** @import { Decided, Duplicate, MergedShape, Undone } from "./types.js" */

const MERGE = "merge";

/** The decisions, with their keys. */
const CHOICES = [
  ["same", "Same", "1"], ["variant", "Variant", "2"], ["different", "Different", "3"], ["ignore", "Ignore", "4"],
  [MERGE, "Merge", "5"],
];
export const UNDO = "u";

/** What undoes the decisions of this page, the latest last. @type {(() => Promise<unknown>)[]} */
const undoes = [];

/** @param {string} key @returns {string | undefined} The decision of a key. */
export const decisionOf = (key) => CHOICES.find(([, , own]) => own === key)?.[0];

/** @param {string} decision */
export const wordOf = (decision) => CHOICES.find(([name]) => name === decision)?.[1] ?? decision;

/**
 * The buttons that decide a group.
 * @param {(decision: string) => void} decided
 */
export function choices(decided) {
  const buttons = CHOICES.map(([name, text, key]) => {
    const choice = button(text, () => decided(name));
    choice.setAttribute("aria-keyshortcuts", key);
    choice.title = name === MERGE ? `Keep the shape stored first, with the tags and metadata of all. Key ${key}` : `Key ${key}`;
    return choice;
  });
  return make("div", { className: "buttons" }, ...buttons);
}

/**
 * Decide every pair of a group, or merge it; false if a merge that cannot be undone is not confirmed.
 * @param {Duplicate[]} members
 * @param {string} decision
 */
export async function decide(members, decision) {
  const shapes = members.map(({ shape }) => shape.id);
  if (decision === MERGE) return merge(members.slice(1).map(({ shape }) => shape), shapes);
  /** @type {Decided} */
  const { id } = await askWith(address("duplicates/decisions"), { shapes, decision });
  undoes.push(() => ask(address(`duplicates/decisions/${id}`), { method: "DELETE" }));
  return true;
}

/**
 * @param {{ name: string }[]} others The shapes that go.
 * @param {string[]} shapes
 */
async function merge(others, shapes) {
  if (!await mayDelete(others)) return false;
  /** @type {MergedShape} */
  const merged = await askWith(address("duplicates/merge"), { shapes, keep: shapes[0] });
  const { id } = merged;
  if (id) undoes.push(() => undoMerge(id));
  // Undo takes the latest decision back, and never an earlier one.
  else undoes.length = 0;
  return true;
}

/** @param {string} id */
async function undoMerge(id) {
  /** @type {Undone} */
  const { left } = await (await ask(address(`duplicates/merges/${id}/undo`), { method: "POST" })).json();
  if (left.length > 0) throw new Error(left[0].reason);
}

/** Whether the latest decision can be undone. */
export const canUndo = () => undoes.length > 0;

/** Undo the latest decision; false if there is none. */
export async function undo() {
  const latest = undoes.pop();
  if (latest === undefined) return false;
  try {
    await latest();
  } catch (error) {
    undoes.push(latest);
    throw error;
  }
  return true;
}
