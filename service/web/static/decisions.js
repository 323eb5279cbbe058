// Decisions on groups of duplicates, and merges of them, by buttons and keys. The last one can be undone.

import { address, ask, askWith } from "./api.js";
import { mayDelete } from "./deleted.js";
import { button, countOf, make } from "./dom.js";

/** @import { Decided, Duplicate, MergedShape, Undone } from "./types.js" */

export const MERGE = "merge";

/** The decisions, with their keys. */
const CHOICES = [
  ["same", "Same", "1"], ["variant", "Variant", "2"], ["different", "Different", "3"], ["ignore", "Ignore", "4"],
  [MERGE, "Merge", "5"],
];
export const KEEP = "k", UNDO = "u";

/** The decisions and merges of this page that can be undone, the latest last. @type {{ action: string, id: string }[]} */
const done = [];

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
    choice.title = name === MERGE ? `Keep one shape, with the tags and metadata of all, and delete the others. Key ${key}` : `Key ${key}`;
    return choice;
  });
  return make("div", { className: "buttons" }, ...buttons);
}

/**
 * Decide every pair of a group, or merge it; false if a merge that cannot be undone is not confirmed.
 * @param {Duplicate[]} members
 * @param {string} decision
 * @param {string} keep The id of the shape that a merge keeps.
 */
export async function decide(members, decision, keep) {
  const shapes = members.map(({ shape }) => shape.id);
  if (decision === MERGE) return merge(members.map(({ shape }) => shape).filter(({ id }) => id !== keep), shapes, keep);
  /** @type {Decided} */
  const { id } = await askWith(address("duplicates/decisions"), { shapes, decision });
  done.push({ action: decision, id });
  return true;
}

/**
 * @param {{ name: string }[]} others The shapes that go.
 * @param {string[]} shapes
 * @param {string} keep
 */
async function merge(others, shapes, keep) {
  if (!await mayDelete(others)) return false;
  /** @type {MergedShape} */
  const { id } = await askWith(address("duplicates/merge"), { shapes, keep });
  if (id) done.push({ action: MERGE, id });
  // Undo takes the latest decision back, and never an earlier one.
  else done.length = 0;
  return true;
}

/**
 * Merge all groups of the same part that pass filters; null if a merge that cannot be undone is not confirmed.
 * @param {Record<string, unknown>} filters
 * @param {string} keep
 * @param {number} groups Their number.
 * @returns {Promise<Decided | null>}
 */
export async function mergeAll(filters, keep, groups) {
  if (!await mayDelete([{ name: `All but one shape of ${countOf(groups, "group")}` }])) return null;
  /** @type {Decided} */
  const merged = await applyRule(filters, { keep, dry_run: false });
  if (merged.id) done.push({ action: MERGE, id: merged.id });
  else done.length = 0;
  return merged;
}

/**
 * Apply the rule that merges all groups of the same part that pass filters, or count them.
 * @param {Record<string, unknown>} filters
 * @param {Record<string, unknown>} how
 * @returns {Promise<Decided>}
 */
export const applyRule = (filters, how) => askWith(address("duplicates/rule"), { ...filters, action: MERGE, ...how });

/** Undo a decision or a merge. @param {{ action: string, id: string }} act */
export async function undo({ action, id }) {
  if (action !== MERGE) {
    await ask(address(`duplicates/decisions/${id}`), { method: "DELETE" });
  } else {
    /** @type {Undone} */
    const { left } = await (await ask(address(`duplicates/merges/${id}/undo`), { method: "POST" })).json();
    if (left.length > 0) throw new Error(left[0].reason);
  }
  const place = done.findIndex((act) => act.id === id);
  if (place >= 0) done.splice(place, 1);
}

/** The latest decision or merge of this page, if it can be undone. */
export const latest = () => done.at(-1);
