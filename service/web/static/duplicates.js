// Groups of near-identical shapes: copies of one size or of any, mirror images and, if asked for, variants.

import { address, ask } from "./api.js";
import { copyVerdict } from "./card.js";
import { applyRule, choices, decide, decisionOf, KEEP, latest, MERGE, mergeAll, UNDO, undo, wordOf } from "./decisions.js";
import { deleted, erased } from "./deleted.js";
import { button, byId, countOf, make, showError } from "./dom.js";
import { moment } from "./facts.js";
import { changedIn, fill, parametersOf, tagsIn } from "./fields.js";
import { menuButton, shapeCard } from "./shape_card.js";
import { current, keep } from "./state.js";

/** @import { State } from "./state.js" */
/** @import { Act, Acts, Duplicate, Duplicates, Shape } from "./types.js" */

/** Groups that are added at a time. */
const PAGE = 20;
/** For how long a request compares shapes: others wait for it. */
const JUDGING_SECONDS = "2";

const form = byId("duplicates-form", HTMLFormElement);
const list = byId("duplicates", HTMLUListElement);
const status = byId("duplicates-status", HTMLElement);
const errorBox = byId("duplicates-error", HTMLElement);
const more = byId("duplicates-more", HTMLButtonElement);
const exported = byId("duplicates-export", HTMLAnchorElement);
const offer = byId("duplicates-decided", HTMLElement);
const mergeForm = byId("merge-form", HTMLFormElement);
const acts = byId("acts", HTMLDetailsElement);
const actsList = byId("acts-list", HTMLUListElement);

let changes = false;
/** @type {Duplicate[][]} */
let groups = [];
let searched = { shapes: 0, unjudged: 0 };
/** Whether a decision is being undone. */
let undoing = false;
/** Whether the list of decisions gets the focus when it is there. */
let wantsActs = false;
/** Groups that were decided since the list was asked for: an answer may still have them. @type {Set<string>} */
const settled = new Set();
/** Number of the current list; a response for an earlier list is discarded. */
let generation = 0;

/** @param {boolean} may Whether shapes may be deleted, and groups decided. */
export const allowDeletions = (may) => {
  changes = may;
  for (const id of ["duplicates-keys", "duplicates-merge"]) byId(id, HTMLElement).hidden = !may;
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
  settled.clear();
  try {
    // The known groups come at once; others follow until no more shapes can be compared, or another view is open.
    for (let left = Infinity, seconds = "0"; left > 0 && current().view === "duplicates"; seconds = JUDGING_SECONDS) {
      const wanted = new URLSearchParams([...parametersOf(form), ["judging_seconds", seconds]]);
      /** @type {Duplicates} */
      const found = await (await ask(address("duplicates", wanted))).json();
      if (own !== generation) return;
      showError(errorBox);
      if (left === Infinity) show(found);
      else join(found);
      if (seconds !== "0" && found.unjudged >= left) break;
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

/**
 * Add the groups that were found since, and take those away that have got other shapes; the others stay in place.
 * @param {Duplicates} found
 */
function join(found) {
  const wanted = found.groups.filter((members) => !settled.has(keyOf(members)));
  const keys = new Set(wanted.map(keyOf));
  for (const members of groups.filter((each) => !keys.has(keyOf(each)))) leave(members);
  const known = new Set(groups.map(keyOf));
  wanted.forEach((members, place) => {
    if (known.has(keyOf(members))) return;
    groups.splice(place, 0, members);
    if (place < list.children.length) list.children[place].before(group(members));
  });
  searched = found;
  exported.hidden = groups.length === 0;
  append(Math.max(0, PAGE - list.children.length));
  tell();
}

/** Take a group from the list. @param {Duplicate[]} members */
function leave(members) {
  const place = groups.indexOf(members);
  groups.splice(place, 1);
  list.children[place]?.remove();
}

/** @param {Duplicate[]} members */
const keyOf = (members) => members.map(({ shape }) => shape.id).sort().join();

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

/** The choices of the shape that a merge of a group keeps, one a shape. @param {number} place Of the group. */
const keepers = (place) => [...list.children[place]?.querySelectorAll("input") ?? []];

/**
 * Decide a group, which leaves the list; the next one gets the focus.
 * @param {Duplicate[]} members
 * @param {string} decision
 */
async function settle(members, decision) {
  try {
    const keep = keepers(groups.indexOf(members)).find(({ checked }) => checked)?.value ?? members[0].shape.id;
    if (!await decide(members, decision, keep)) return;
    showError(errorBox);
    showActs();
    const place = groups.indexOf(members);
    if (place < 0) return load();
    settled.add(keyOf(members));
    leave(members);
    if (list.children.length === 0) append(PAGE);
    tell();
    offer.replaceChildren(
      `${decision === MERGE ? "Merged into" : `${wordOf(decision)}:`} ${(members.find(({ shape }) => shape.id === keep) ?? members[0]).shape.name}. `,
      ...(latest() ? [button("Undo", takeBack)] : []),
    );
    const next = /** @type {HTMLElement | undefined} */ (list.children[place] ?? list.lastElementChild ?? offer);
    next?.focus();
  } catch (error) {
    showError(errorBox, error);
  }
}

/** The filters of the form, as a rule has them. */
function filters() {
  const parameters = parametersOf(form);
  const { tag, scaled, mirrored, variants, decided, ...others } = Object.fromEntries(parameters);
  return {
    ...others, tag: tagsIn(tag ?? ""), metadata: parameters.getAll("metadata"),
    scaled: scaled === "true", mirrored: mirrored !== "false", variants: variants === "true",
  };
}

/** Tell how many groups are of the same part, and ask which shape of each to keep. */
async function askToMerge() {
  try {
    const { groups: many } = await applyRule(filters(), { dry_run: true });
    showError(errorBox);
    mergeForm.hidden = many === 0;
    offer.replaceChildren(many === 0 ? "No undecided group has the same part only." : "");
    byId("merge-text", HTMLElement).textContent = `${countOf(many, "undecided group")} of the same part: `
      + "one shape of each stays, with the tags and metadata of all, and the others are deleted.";
    mergeForm.dataset.groups = String(many);
    byId("merge-keep", HTMLSelectElement).focus();
  } catch (error) {
    showError(errorBox, error);
  }
}

async function mergeGroups() {
  mergeForm.hidden = true;
  offer.replaceChildren("Merging …");
  offer.focus({ preventScroll: true });
  try {
    const merged = await mergeAll(filters(), byId("merge-keep", HTMLSelectElement).value, Number(mergeForm.dataset.groups));
    showError(errorBox);
    const left = merged?.left.length ? ` ${countOf(merged.left.length, "group")} not: ${merged.left[0].reason}.` : "";
    offer.replaceChildren(
      merged ? `Merged ${countOf(merged.groups, "group")}.${left} ` : "", ...(merged?.id ? [button("Undo", takeBack)] : []),
    );
    showActs();
    load();
  } catch (error) {
    offer.replaceChildren();
    showError(errorBox, error);
  }
}

/** Undo the latest decision of this page; if there is none, show those before it. */
async function takeBack() {
  const act = latest();
  if (undoing) return;
  if (act) return undone(act);
  wantsActs = true;
  if (acts.open) return showActs();
  // This shows them.
  acts.open = true;
}

/** Undo a decision or a merge. @param {{ action: string, id: string }} act */
async function undone(act) {
  undoing = true;
  offer.replaceChildren("Undoing …");
  try {
    await undo(act);
    showError(errorBox);
    offer.replaceChildren(act.action === MERGE ? "The merge was undone." : "The decision was undone.");
    offer.focus({ preventScroll: true });
    showActs();
    load();
  } catch (error) {
    offer.replaceChildren();
    showError(errorBox, error);
  } finally {
    undoing = false;
  }
}

/** List the latest decisions and merges, if the list is open. */
async function showActs() {
  if (!acts.open) return;
  try {
    /** @type {Acts} */
    const found = await (await ask(address("duplicates/acts", { limit: "100" }))).json();
    actsList.replaceChildren(...(found.acts.length > 0 ? found.acts.map(line) : [make("li", {}, "none")]));
    if (wantsActs) actsList.querySelector("button")?.focus();
    wantsActs = false;
  } catch (error) {
    showError(errorBox, error);
  }
}

/** @param {Act} act */
function line(act) {
  const { action, names, count, decided_by, decided_at, reason } = act;
  const said = `${wordOf(action)}: ${names.join(", ") || "shapes that are gone"}`;
  const counted = count === 1 ? [] : [countOf(count, action === MERGE ? "group" : "pair")];
  const when = make("time", { dateTime: decided_at }, moment(decided_at));
  const about = [...counted, decided_by, reason].filter(Boolean).map((text) => ` · ${text}`);
  return make(
    "li", {}, make("span", { className: "name" }, said), make("span", {}, when, ...about),
    make("div", { className: "buttons" }, button("Undo", () => undone(act), `Undo ${said}`)),
  );
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
  const decided = one.decision ? `, decided: ${wordOf(one.decision).toLowerCase()}` : "";
  const line = make("p", { className: "likeness" }, place === 0 ? "Stored first" : copyVerdict(one) + decided);
  const files = one.paths.map((path) => make("p", { className: "change" }, path));
  const keep = changes ? [keeper(one, place, members)] : [];
  made.querySelector(".name")?.after(line, ...keep, make("p", { className: "change" }, differs(one, members)), ...files);
  return made;
}

/**
 * The choice of the shape that a merge keeps.
 * @param {Duplicate} one
 * @param {number} place
 * @param {Duplicate[]} members
 */
function keeper({ shape }, place, members) {
  const input = make("input", {
    type: "radio", name: `keep-${members[0].shape.id}`, value: shape.id, checked: place === 0, ariaLabel: `Keep ${shape.name}`,
  });
  return make("label", { className: "keep" }, input, " Keep");
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
  const types = target instanceof HTMLInputElement && !["checkbox", "radio"].includes(target.type);
  const writes = types || target instanceof HTMLSelectElement || target instanceof HTMLTextAreaElement;
  if (!changes || current().view !== "duplicates" || writes || repeat || ctrlKey || altKey || metaKey) return;
  if (key.toLowerCase() === UNDO) {
    takeBack();
    return;
  }
  const decision = decisionOf(key);
  const place = [...list.children].findIndex((child) => child.contains(document.activeElement));
  if (key.toLowerCase() === KEEP) {
    const inputs = keepers(Math.max(place, 0));
    const next = inputs[(inputs.findIndex(({ checked }) => checked) + 1) % inputs.length];
    if (next) next.checked = true;
    return;
  }
  const members = groups[Math.max(place, 0)];
  if (decision !== undefined && members !== undefined) settle(members, decision);
});
more.addEventListener("click", () => append(PAGE));
acts.addEventListener("toggle", showActs);
byId("duplicates-merge", HTMLButtonElement).addEventListener("click", askToMerge);
byId("merge-cancel", HTMLButtonElement).addEventListener("click", () => (mergeForm.hidden = true));
mergeForm.addEventListener("submit", (event) => {
  event.preventDefault();
  mergeGroups();
});
