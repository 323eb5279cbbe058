// Groups of near-identical shapes: copies of one size or of any, mirror images and, if asked for, variants.

import { address, ask } from "./api.js";
import { copyVerdict } from "./card.js";
import { canUndo, choices, decide, decisionOf, UNDO, undo, wordOf } from "./decisions.js";
import { deleted, erased } from "./deleted.js";
import { button, byId, countOf, make, showError } from "./dom.js";
import { changedIn, fill, parametersOf } from "./fields.js";
import { menuButton, shapeCard } from "./shape_card.js";
import { current, keep } from "./state.js";

/** @import { State } from "./state.js" */
/** @import { Duplicate, Duplicates, Shape } from "./types.js" */

/** Groups that are added at a time. */
const PAGE = 20;

const form = byId("duplicates-form", HTMLFormElement);
const list = byId("duplicates", HTMLUListElement);
const status = byId("duplicates-status", HTMLElement);
const errorBox = byId("duplicates-error", HTMLElement);
const more = byId("duplicates-more", HTMLButtonElement);
const exported = byId("duplicates-export", HTMLAnchorElement);
const offer = byId("duplicates-decided", HTMLElement);

let changes = false;
/** @type {Duplicate[][]} */
let groups = [];
let searched = { shapes: 0, unjudged: 0 };
/** Number of the current list; a response for an earlier list is discarded. */
let generation = 0;

/** @param {boolean} may Whether shapes may be deleted, and groups decided. */
export const allowDeletions = (may) => {
  changes = may;
  byId("duplicates-keys", HTMLElement).hidden = !may;
};

/**
 * Show the groups of the address.
 * @param {State} state
 */
export function openDuplicates({ parameters }) {
  fill(form, parameters);
  load();
}

/** Show the groups, and ask again while shapes are still to be compared. */
async function load() {
  const own = ++generation;
  exported.hidden = true;
  status.textContent = "Comparing the stored shapes …";
  try {
    // Until no more of them can be compared, or another view is open.
    for (let left = Infinity; left > 0 && current().view === "duplicates";) {
      /** @type {Duplicates} */
      const found = await (await ask(address("duplicates", parametersOf(form)))).json();
      if (own !== generation) return;
      showError(errorBox);
      show(found);
      if (found.unjudged >= left) break;
      left = found.unjudged;
    }
  } catch (error) {
    if (own !== generation) return;
    status.textContent = "";
    showError(errorBox, error);
  }
}

/** @param {Duplicates} found */
function show(found) {
  groups = found.groups;
  searched = found;
  exported.hidden = groups.length === 0;
  exported.href = address("duplicates", new URLSearchParams([...parametersOf(form), ["format", "csv"]]));
  const shown = Math.max(PAGE, list.children.length);
  list.replaceChildren();
  append(shown);
  tell();
}

/** Tell the number of groups. */
function tell() {
  const { shapes, unjudged } = searched;
  const counted = groups.length === 0 ? `No duplicates among ${countOf(shapes, "shape")}.`
    : `${countOf(groups.length, "group")} of duplicates among ${countOf(shapes, "shape")}.`;
  const left = unjudged === 0 ? "" : ` ${countOf(unjudged, "shape")} ${unjudged === 1 ? "is" : "are"} still to be compared.`;
  status.textContent = counted + left;
}

/** @param {number} count Number of groups to add. */
function append(count) {
  const start = list.children.length;
  list.append(...groups.slice(start, start + count).map(group));
  more.hidden = list.children.length === groups.length;
}

/** @param {Duplicate[]} members */
const group = (members) => make(
  "li", { tabIndex: -1 },
  make("h3", {}, `${members.length} shapes`),
  ...(changes ? [choices((decision) => settle(members, decision))] : []),
  make("ul", { className: "gallery" }, ...members.map(item)),
);

/**
 * Decide a group, which leaves the list; the next one gets the focus.
 * @param {Duplicate[]} members
 * @param {string} decision
 */
async function settle(members, decision) {
  try {
    if (!await decide(members, decision)) return;
    showError(errorBox);
    const place = groups.indexOf(members);
    if (place < 0) return load();
    groups.splice(place, 1);
    list.children[place].remove();
    if (list.children.length === 0) append(PAGE);
    tell();
    offer.replaceChildren(
      `${wordOf(decision)}: ${members[0].shape.name}. `, ...(canUndo() ? [button("Undo", takeBack)] : []),
    );
    const next = /** @type {HTMLElement | undefined} */ (list.children[place] ?? list.lastElementChild ?? offer);
    next?.focus();
  } catch (error) {
    showError(errorBox, error);
  }
}

/** Undo the latest decision. */
async function takeBack() {
  try {
    if (!await undo()) return;
    offer.replaceChildren("The decision was undone.");
    offer.focus({ preventScroll: true });
    load();
  } catch (error) {
    showError(errorBox, error);
  }
}

/** What differs, and from which shape, if that is not the first. @param {Duplicate} one @param {Duplicate[]} members */
function differs({ difference, compared_with }, members) {
  if (difference === null || compared_with === members[0].shape.id) return difference?.text ?? "";
  const other = members.find(({ shape }) => shape.id === compared_with);
  return `${difference.text}; compared with ${other?.shape.name ?? compared_with}`;
}

/**
 * @param {Duplicate} one
 * @param {number} place In its group; the others are compared with the first.
 * @param {Duplicate[]} members
 */
function item(one, place, members) {
  const { shape } = one;
  const made = shapeCard(shape, menuButton(shape, changes ? () => remove(shape) : null));
  const line = make("p", { className: "likeness" }, place === 0 ? "Stored first" : copyVerdict(one));
  const files = one.paths.map((path) => make("p", { className: "change" }, path));
  made.querySelector(".name")?.after(line, make("p", { className: "change" }, differs(one, members)), ...files);
  return made;
}

/** @param {Shape} shape */
async function remove(shape) {
  try {
    if (!await erased(shape)) return;
    deleted(shape);
    load();
  } catch (error) {
    showError(errorBox, error);
  }
}

form.addEventListener("change", () => {
  keep(changedIn(form));
  load();
});
form.addEventListener("submit", (event) => event.preventDefault());
document.addEventListener("keydown", (event) => {
  const { key, target, repeat, ctrlKey, altKey, metaKey } = event;
  const writes = target instanceof HTMLInputElement || target instanceof HTMLSelectElement || target instanceof HTMLTextAreaElement;
  if (!changes || current().view !== "duplicates" || writes || repeat || ctrlKey || altKey || metaKey) return;
  if (key.toLowerCase() === UNDO) {
    takeBack();
    return;
  }
  const decision = decisionOf(key);
  const place = [...list.children].findIndex((child) => child.contains(document.activeElement));
  const members = groups[Math.max(place, 0)];
  if (decision !== undefined && members !== undefined) settle(members, decision);
});
more.addEventListener("click", () => append(PAGE));
