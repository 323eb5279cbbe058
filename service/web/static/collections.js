// The collection that the page works in, chosen where there are several, and kept in its address.

import { address, ask, collection } from "./api.js";
import { byId, make } from "./dom.js";

/** @import { Collections } from "./types.js" */

const form = byId("collections", HTMLFormElement);
const choice = byId("collection", HTMLSelectElement);

/** @param {string} name */
const at = (name) => {
  const url = new URL(location.href);
  url.searchParams.set("collection", name);
  return url.href;
};

/** Offer the collections; true where the page leaves for the first of them, since it must name one. */
export async function openCollections() {
  /** @type {Collections} */
  const { collections } = await (await ask(address("collections"))).json();
  const names = collections.map(({ name }) => name);
  if (!collection && names.length > 1 && !names.includes("default")) {
    location.replace(at(names[0]));
    return true;
  }
  choice.replaceChildren(...collections.map(({ name, shapes }) => make(
    "option", { value: name, selected: name === (collection || "default") }, `${name} (${shapes})`,
  )));
  form.hidden = names.length < 2;
  return false;
}

choice.addEventListener("change", () => location.assign(at(choice.value)));
form.addEventListener("submit", (event) => event.preventDefault());
