// Before the first search: some stored shapes to start from.

import { address, ask } from "./api.js";
import { byId, make, showError } from "./dom.js";
import { shapeCard } from "./shape_card.js";
import { linkTo } from "./state.js";

/** @import { ShapePage } from "./types.js" */

const SHOWN = "12";

/** Show them, or how to begin where nothing is stored. */
export async function openStart() {
  try {
    /** @type {ShapePage} */
    const { shapes, total } = await (await ask(address("shapes", { limit: SHOWN }))).json();
    const link = total === 0 ? make("a", { href: linkTo("upload") }, "Upload the first shapes")
      : make("a", { href: linkTo("browse") }, `Browse all ${total}`);
    link.dataset.view = total === 0 ? "upload" : "browse";
    byId("start-text", HTMLElement).replaceChildren(
      total === 0 ? "No shapes are stored yet. " : "Or start from a stored shape. ", link,
    );
    byId("start-shapes", HTMLUListElement).replaceChildren(...shapes.map((shape) => shapeCard(shape)));
  } catch (error) {
    showError(byId("find-error", HTMLElement), error);
  }
}
