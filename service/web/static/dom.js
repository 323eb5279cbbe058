// Finding and making elements.

/**
 * The element with an id, which is of a kind.
 * @template {HTMLElement} T
 * @param {string} id
 * @param {{ new (): T, name: string }} kind
 * @returns {T}
 */
export function byId(id, kind) {
  const found = document.getElementById(id);
  if (!(found instanceof kind)) throw new Error(`#${id} is no ${kind.name}`);
  return found;
}

/**
 * An element with properties and children.
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
 * A button that does something.
 * @param {string} text
 * @param {() => void} action
 * @param {string} [label] What a screen reader says, if more than the text.
 */
export function button(text, action, label) {
  const made = make("button", { type: "button" }, text);
  if (label) made.setAttribute("aria-label", label);
  made.addEventListener("click", action);
  return made;
}

/**
 * Show an error in a place for it, or hide the place.
 * @param {HTMLElement} place
 * @param {unknown} [error]
 */
export function showTrouble(place, error) {
  place.hidden = error === undefined;
  place.textContent = error === undefined ? "" : error instanceof Error ? error.message : String(error);
}

/**
 * Take files that are dropped on an element.
 * @param {HTMLElement} place
 * @param {(files: File[]) => void} take
 */
export function onDrop(place, take) {
  place.addEventListener("dragover", (event) => {
    event.preventDefault();
    place.classList.add("over");
  });
  place.addEventListener("dragleave", () => place.classList.remove("over"));
  place.addEventListener("drop", (event) => {
    event.preventDefault();
    place.classList.remove("over");
    const files = [...(event.dataTransfer?.files ?? [])];
    if (files.length > 0) take(files);
  });
}

/**
 * What is written with commas between, in parts.
 * @param {string} text
 */
export const listed = (text) => text.split(",").map((part) => part.trim()).filter(Boolean);
