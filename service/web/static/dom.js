// Helpers for elements of the document.

/**
 * The element with an id; throws if it is not of the given class.
 * @template {HTMLElement} T
 * @param {string} id
 * @param {{ new (): T, name: string }} kind
 * @returns {T}
 */
export function byId(id, kind) {
  const found = document.getElementById(id);
  if (!(found instanceof kind)) throw new Error(`#${id} is not a ${kind.name}`);
  return found;
}

/**
 * Create an element with properties and children.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Partial<HTMLElementTagNameMap[K]>} properties
 * @param {...(Node | string)} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function make(tag, properties, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

/**
 * Create a button.
 * @param {string} text
 * @param {() => void} action
 * @param {string} [label] Label for screen readers, if it differs from the text.
 */
export function button(text, action, label) {
  const made = make("button", { type: "button" }, text);
  if (label) made.setAttribute("aria-label", label);
  made.addEventListener("click", action);
  return made;
}

/** Such as "1 shape", or "2 shapes". @param {number} count @param {string} noun */
export const countOf = (count, noun) => `${count} ${count === 1 ? noun : `${noun}s`}`;

/** The message of an error. @param {unknown} error */
export const messageOf = (error) => (error instanceof Error ? error.message : String(error));

/**
 * Show an error message in an element, or hide the element.
 * @param {HTMLElement} place
 * @param {unknown} [error]
 */
export function showError(place, error) {
  place.hidden = error === undefined;
  place.textContent = error === undefined ? "" : messageOf(error);
}

/**
 * The function that calls another once and returns its result each time.
 * @template T
 * @param {() => T} load
 */
export function cached(load) {
  /** @type {T | undefined} */
  let loaded;
  return () => (loaded ??= load());
}
