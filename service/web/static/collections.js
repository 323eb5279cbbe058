// The choice of the collection, which the address of the page keeps.

import { address, ask, collection } from "./api.js";
import { byId, make } from "./dom.js";
import { current } from "./state.js";

/** @import { Collections } from "./types.js" */

const form = byId("collections", HTMLFormElement);
const choice = byId("collection", HTMLSelectElement);

/** The address of the view in another collection. @param {string} name */
const addressOf = (name) => {
  const { view } = current();
  return `${location.pathname}?${new URLSearchParams({ view, collection: name })}`;
};

/** Show the collections; true if the page reloads for the first of them, because there is no default one. */
export async function openCollections() {
  /** @type {Collections} */
  const { collections } = await (await ask(address("collections"))).json();
  const names = collections.map(({ name }) => name);
  if (!collection && names.length > 1 && !names.includes("default")) {
    location.replace(addressOf(names[0]));
    return true;
  }
  choice.replaceChildren(...collections.map(({ name, shapes }) => make(
    "option", { value: name, selected: name === (collection || "default") }, `${name} (${shapes})`,
  )));
  form.hidden = names.length < 2;
  return false;
}

choice.addEventListener("change", () => location.assign(addressOf(choice.value)));
form.addEventListener("submit", (event) => event.preventDefault());
