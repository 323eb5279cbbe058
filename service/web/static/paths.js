// Where the shapes of cards are in the library, for keys that may see it.

import { address, ask } from "./api.js";
import { cached } from "./dom.js";

/** @import { Source, SourceFilePage } from "./types.js" */

/** Shapes that one request asks for. */
const AT_ONCE = 60;

let may = false;

/** @param {boolean} full Whether the key may see paths. */
export const allowPaths = (full) => (may = full);

/** The sources as the page is loaded. @type {() => Promise<Source[]>} */
const sources = cached(async () => (await (await ask(address("sources"))).json()).sources);

/**
 * Write the folder of each shape's first file on its card.
 * @param {HTMLElement} list
 */
export async function locate(list) {
  if (!may || (await sources()).length === 0) return;
  /** @type {NodeListOf<HTMLElement>} */
  const links = list.querySelectorAll(":scope > li > .buttons > [data-shape]");
  const cards = [...links].map((link) => /** @type {[string, Element | null]} */ ([link.dataset.shape, link.closest("li")]));
  for (const { id, name, path: root } of await sources()) {
    for (let start = 0; start < cards.length; start += AT_ONCE) {
      const some = new Map(cards.slice(start, start + AT_ONCE));
      const wanted = [["state", "present"], ["limit", "500"], ...[...some.keys()].map((shape) => ["shape_id", shape])];
      /** @type {SourceFilePage} */
      const { files } = await (await ask(address(`sources/${id}/files`, new URLSearchParams(wanted)))).json();
      for (const { path, shape_id } of files.sort((one, other) => (one.path < other.path ? -1 : 1))) {
        /** @type {HTMLElement | null | undefined} */
        const about = some.get(shape_id ?? "")?.querySelector(".about");
        if (!about || about.dataset.path) continue;
        about.dataset.path = path;
        about.title = `${root}/${path} · ${about.textContent}`;
        about.prepend(`${[name, ...path.split("/").slice(0, -1)].join("/")} · `);
      }
    }
  }
}
