// Completion in fields of tags, by all tags of the collection.

import { address, ask } from "./api.js";
import { byId, make } from "./dom.js";

/** @import { Facets } from "./types.js" */

const MOST = "20";
const WAIT_MILLISECONDS = 100;

const offered = byId("tags", HTMLDataListElement);
let timer = 0;

/** Offer the tags that contain the last one of a field. @param {HTMLInputElement} field */
async function complete(field) {
  const typed = field.value;
  const before = typed.replace(/[^,]*$/, ""), last = typed.slice(before.length).trim();
  try {
    /** @type {Facets} */
    const { tags } = await (await ask(address("facets", { tag_text: last, limit: MOST }))).json();
    if (field.value !== typed) return;
    const start = before && `${before} `;
    offered.replaceChildren(...tags.map(({ value }) => make("option", { value: start + value })));
  } catch {
    offered.replaceChildren();
  }
}

for (const type of ["focusin", "input"]) {
  document.addEventListener(type, ({ target }) => {
    if (!(target instanceof HTMLInputElement) || target.list !== offered) return;
    clearTimeout(timer);
    timer = setTimeout(() => complete(target), WAIT_MILLISECONDS);
  });
}
