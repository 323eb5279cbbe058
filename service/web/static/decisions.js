// Decisions on groups of duplicates, by buttons and keys. The last one can be undone.

import { address, ask, askWith } from "./api.js";
import { button, make } from "./dom.js";

/** @import { Decided, Duplicate } from "./types.js" */

/** The decisions, with their keys. */
const CHOICES = [["same", "Same", "1"], ["variant", "Variant", "2"], ["different", "Different", "3"], ["ignore", "Ignore", "4"]];
export const UNDO = "u";

/** The ids of the decisions of this page, the latest last. @type {string[]} */
const made = [];

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
    choice.title = `Key ${key}`;
    return choice;
  });
  return make("div", { className: "buttons" }, ...buttons);
}

/**
 * Decide every pair of a group.
 * @param {Duplicate[]} members
 * @param {string} decision
 */
export async function decide(members, decision) {
  const shapes = members.map(({ shape }) => shape.id);
  /** @type {Decided} */
  const { id } = await askWith(address("duplicates/decisions"), { shapes, decision });
  made.push(id);
}

/** Undo the latest decision; false if there is none. */
export async function undo() {
  const id = made.pop();
  if (id === undefined) return false;
  await ask(address(`duplicates/decisions/${id}`), { method: "DELETE" });
  return true;
}
