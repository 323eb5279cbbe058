// Fields of a form as parameters of a request; the name of a field is the name of its parameter.

import { button, make } from "./dom.js";

/** @typedef {HTMLInputElement | HTMLSelectElement} Field */

/** Filters of an address for which not every form has a field. @type {Record<string, string>} */
const TITLES = {
  name: "Name",
  metadata: "Metadata",
  length: "Longest side",
  area: "Area",
  volume: "Volume",
  file_format: "Format",
  sha256: "SHA-256",
  exclude: "Without",
};

/** @param {HTMLFormElement} form @returns {Field[]} */
const fieldsOf = (form) => [...form.querySelectorAll("input[name], select[name]")].map((field) => /** @type {Field} */ (field));

/** @param {Field} field */
const initial = (field) => field instanceof HTMLSelectElement
  ? ([...field.options].find((option) => option.defaultSelected) ?? field.options[0]).value
  : ["checkbox", "hidden"].includes(field.type) ? "" : field.defaultValue;

/** @param {Field} field */
const valueOf = (field) => field instanceof HTMLInputElement && field.type === "checkbox"
  ? (field.checked ? field.value : "") : field.value.trim();

/**
 * The values of a field: one, or one for each entry of metadata, which are separated by commas.
 * @param {Field} field
 */
const valuesOf = (field) => field.name === "metadata" && field.type !== "hidden"
  ? valueOf(field).split(/,\s*(?=[^=,]+=)/).filter(Boolean) : [valueOf(field)].filter(Boolean);

/** The tags in the text of a field. @param {string} text */
export const tagsIn = (text) => text.split(",").map((tag) => tag.trim()).filter(Boolean);

/**
 * The fields that are not empty.
 * @param {HTMLFormElement} form
 * @param {(field: Field) => boolean} [wanted]
 */
export function parametersOf(form, wanted = () => true) {
  const parameters = new URLSearchParams();
  for (const field of fieldsOf(form).filter(wanted)) {
    for (const value of valuesOf(field)) parameters.append(field.name, value);
  }
  return parameters;
}

/**
 * The fields that differ from their initial values.
 * @param {HTMLFormElement} form
 */
export const changedIn = (form) => parametersOf(form, (field) => valueOf(field) !== initial(field));

/**
 * Fill a form from parameters; fields without a parameter get their initial values.
 * @param {HTMLFormElement} form
 * @param {URLSearchParams} parameters
 */
export function fill(form, parameters) {
  for (const chip of form.querySelectorAll(".filter")) chip.remove();
  for (const field of fieldsOf(form)) {
    const given = parameters.getAll(field.name);
    if (field instanceof HTMLInputElement && field.type === "checkbox") field.checked = given.includes(field.value);
    else field.value = given.length > 0 ? given.join(", ") : initial(field);
  }
  const others = (form.dataset.filters ?? "").split(" ");
  form.append(...[...parameters].filter(([name, value]) => others.includes(name) && value).map(([name, value]) => chip(form, name, value)));
}

/**
 * A filter for which a form has no field, with a button that removes it.
 * @param {HTMLFormElement} form
 * @param {string} name
 * @param {string} value
 */
function chip(form, name, value) {
  const text = `${TITLES[name]}: ${value}`;
  const remove = button("×", () => {
    made.remove();
    fieldsOf(form)[0].focus();
    // As a change of a field.
    for (const type of ["input", "change"]) form.dispatchEvent(new Event(type));
  }, `Remove the filter ${text}`);
  const made = make("span", { className: "filter" }, make("input", { type: "hidden", name, value }), text, remove);
  return made;
}

/**
 * Write the number of filters that are in use beside their title.
 * @param {HTMLFormElement} form
 * @param {HTMLDetailsElement} filters
 * @param {HTMLElement} place
 */
export function showCount(form, filters, place) {
  const used = [...changedIn(form).keys()].filter((name) => filters.querySelector(`[name="${name}"]`));
  place.textContent = used.length > 0 ? `(${used.length})` : "";
}
