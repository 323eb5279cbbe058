// Tags and metadata that similar shapes suggest for a shape; a person adds them, or leaves them.

import { address, ask } from "./api.js";
import { button, byId, make, showError } from "./dom.js";
import { textOf } from "./facts.js";

/** @import { Suggestion, Suggestions } from "./types.js" */

const section = byId("suggestions", HTMLElement);
const list = byId("suggested", HTMLUListElement);
const errorBox = byId("suggested-error", HTMLElement);

/** @param {string} id @param {(suggestion: Suggestion) => Promise<void>} add */
export async function showSuggestions(id, add) {
  showError(errorBox);
  /** @type {Suggestions} */
  const { suggestions } = await (await ask(address(`shapes/${id}/suggestions`))).json();
  section.hidden = suggestions.length === 0;
  list.replaceChildren(...suggestions.map((suggestion) => {
    const { key, value, share, shapes } = suggestion;
    const text = key === null ? textOf(value) : `${key}: ${textOf(value)}`;
    const accept = async () => {
      try {
        await add(suggestion);
      } catch (error) {
        showError(errorBox, error);
      }
    };
    const links = shapes.flatMap((shape, i) => [i === 0 ? "" : ", ", make("a", { href: address(`shapes/${shape.id}/view`) }, shape.name)]);
    return make("li", {}, button("Add", accept, `Add ${text}`), ` ${text}, ${Math.round(100 * share)} %: `, ...links);
  }));
}
