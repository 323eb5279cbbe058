// The facets of the list: how many of its shapes have a tag, a format or a size, each a link that narrows the list.

import { address, ask, collection } from "./api.js";
import { byId, make } from "./dom.js";
import { tagsIn } from "./fields.js";
import { linkTo } from "./state.js";

/** @import { Count, Facets } from "./types.js" */

const SHOWN = 15;

const box = byId("facets", HTMLDetailsElement);
const groups = byId("facet-groups", HTMLElement);

/** The parameters that the facets are of. */
let shown = "";

/** @param {URLSearchParams} parameters Of the list. */
export async function showFacets(parameters) {
  const wanted = new URLSearchParams(parameters);
  wanted.delete("sort");
  const own = (shown = wanted.toString());
  // A list of one file needs no facets, and they take no hash.
  if (wanted.has("sha256")) return groups.replaceChildren();
  wanted.set("limit", String(SHOWN));
  try {
    /** @type {Facets} */
    const found = await (await ask(address("facets", wanted))).json();
    if (own === shown) show(found, parameters);
  } catch {
    // The list, which has the same filters, tells the error.
    if (own === shown) groups.replaceChildren();
  }
}

/** @param {Facets} found @param {URLSearchParams} parameters */
function show({ tags, distinct_tags, formats, lengths, collections }, parameters) {
  const given = tagsIn(parameters.get("tag") ?? "");
  const chosen = given.filter((tag) => !tags.some(({ value }) => value === tag)).map((value) => ({ value, count: 0 }));
  /** @param {string} name @param {string} value */
  const only = (name, value) => link(parameters, name, parameters.get(name) === value ? "" : value);
  groups.replaceChildren(
    ...group("Tags", [...tags, ...chosen], given, (tag) => (
      link(parameters, "tag", (given.includes(tag) ? given.filter((other) => other !== tag) : [...given, tag]).join(", "))
    ), distinct_tags - tags.length),
    ...group("Longest side", lengths, [parameters.get("length")], (value) => only("length", value)),
    ...group("Format", formats, [parameters.get("file_format")], (value) => only("file_format", value)),
    ...(collections.length < 2 ? [] : group("Collection", collections, [collection || "default"], (value) => {
      const all = new URLSearchParams(parameters);
      all.set("view", "browse");
      all.set("collection", value);
      return make("a", { href: `${location.pathname}?${all}` });
    })),
  );
}

/** A link to the list with another value of a parameter. @param {URLSearchParams} parameters @param {string} name @param {string} value */
function link(parameters, name, value) {
  const changed = new URLSearchParams(parameters);
  if (value) changed.set(name, value);
  else changed.delete(name);
  const made = make("a", { href: linkTo("browse", changed) });
  made.dataset.view = "browse";
  return made;
}

/**
 * @param {string} title
 * @param {Count[]} counts
 * @param {(string | null)[]} chosen
 * @param {(value: string) => HTMLAnchorElement} linkOf
 * @param {number} [more] Number of values that are not shown.
 */
function group(title, counts, chosen, linkOf, more = 0) {
  if (counts.length === 0) return [];
  const items = counts.map(({ value, count, least, greatest }) => {
    const own = linkOf(value);
    own.append(make("span", {}, least === undefined ? value : `${least} – ${greatest}`), make("span", { className: "count" }, count.toLocaleString("en")));
    if (chosen.includes(value)) own.setAttribute("aria-current", "true");
    return make("li", {}, own);
  });
  if (more > 0) items.push(make("li", { className: "more" }, `${more.toLocaleString("en")} more, by the filter Tags`));
  const heading = make("h3", { id: `facet-${title.toLowerCase().replace(" ", "-")}` }, title);
  const list = make("ul", {}, ...items);
  list.setAttribute("aria-labelledby", heading.id);
  return [heading, list];
}

// On a small screen the shapes come first.
box.open = !matchMedia("(max-width: 60rem)").matches;
