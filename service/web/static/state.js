// The state of the page: the address names the view and its parameters, as the HTTP interface names them.

import { collection } from "./api.js";

/** Receives an event when the address changes. */
export const moved = new EventTarget();

/** Files of queries. The address cannot hold them, so an entry of the history holds their number. @type {File[]} */
const files = [];

/** @typedef {{ view: string, parameters: URLSearchParams, file: File | null, fileName: string }} State */

/**
 * The view and the parameters of the address; `file` is the query, if it is a file that is still open.
 * @returns {State}
 */
export function current() {
  const parameters = new URLSearchParams(location.search);
  const view = parameters.get("view") ?? "find";
  for (const name of ["view", "collection"]) parameters.delete(name);
  const { file: number = -1, fileName = "" } = history.state ?? {};
  return { view, parameters, file: files[number] ?? null, fileName };
}

/**
 * The address of a view in the page's collection.
 * @param {string} view
 * @param {URLSearchParams | Record<string, string>} [parameters]
 */
export function linkTo(view, parameters = {}) {
  const all = new URLSearchParams();
  if (collection) all.set("collection", collection);
  if (view !== "find") all.set("view", view);
  for (const [name, value] of new URLSearchParams(parameters)) all.append(name, value);
  return `${location.pathname}${all.size > 0 ? `?${all}` : ""}`;
}

/**
 * Go to a view.
 * @param {string} view
 * @param {URLSearchParams | Record<string, string>} [parameters]
 * @param {File | null} [file] The query, if it is a file.
 */
export function go(view, parameters, file = null) {
  const link = linkTo(view, parameters);
  if (link !== location.pathname + location.search || file !== current().file) {
    if (file && !files.includes(file)) files.push(file);
    history.pushState(file && { file: files.indexOf(file), fileName: file.name }, "", link);
  }
  moved.dispatchEvent(new Event("moved"));
}

/**
 * Keep the parameters of the current view in the address, without an entry of the history.
 * @param {URLSearchParams} parameters
 */
export const keep = (parameters) => history.replaceState(history.state, "", linkTo(current().view, parameters));

/** @param {MouseEvent} event Whether a click opens a link elsewhere, as in another tab. */
export const opensElsewhere = (event) =>
  event.button !== 0 || event.ctrlKey || event.metaKey || event.shiftKey || event.altKey;

addEventListener("popstate", () => moved.dispatchEvent(new Event("moved")));
