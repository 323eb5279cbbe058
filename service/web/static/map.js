// The map of the stored shapes: each takes a cell of a grid, near similar ones.

import { address, ask } from "./api.js";
import { byId, countOf, make, showError } from "./dom.js";
import { changedIn, fill, parametersOf } from "./fields.js";
import { keep, linkTo } from "./state.js";

/** @import { State } from "./state.js" */
/** @import { ShapeMap } from "./types.js" */

/** Widths of a cell, in pixels. */
const LEAST = 24, GREATEST = 160, STEP = 1.4;

const form = byId("map-form", HTMLFormElement);
const frame = byId("map-frame", HTMLElement);
const list = byId("map", HTMLUListElement);
const status = byId("map-status", HTMLElement);
const errorBox = byId("map-error", HTMLElement);

/** The parameters of the current map. @type {string | null} */
let shown = null;
let size = 1;
/** The address of the sheet of pictures. */
let url = "";
let width = LEAST;
/** The link of each cell, by column and row. @type {Map<string, HTMLAnchorElement>} */
const cells = new Map();

/**
 * Show the map of the address.
 * @param {State} state
 */
export function openMap({ parameters }) {
  fill(form, parameters);
  load();
}

/** @param {boolean} [again] Whether to load the map anew if shapes were stored or deleted meanwhile. */
async function load(again = true) {
  const wanted = parametersOf(form).toString();
  shown = wanted;
  status.textContent = "Laying the shapes out …";
  try {
    /** @type {ShapeMap} */
    const found = await (await ask(address("map", parametersOf(form)))).json();
    if (wanted !== shown) return;
    showError(errorBox);
    show(found);
    await drawSheet(found, wanted, again);
  } catch (error) {
    if (wanted !== shown) return;
    status.textContent = "";
    showError(errorBox, error);
  }
}

/** The place of a column or row of the sheet. @param {number} place */
const share = (place) => `${size > 1 ? (100 * place) / (size - 1) : 0}%`;

/**
 * Put one sheet of all pictures over the dots, and ask again while the service has not drawn all of them.
 * @param {ShapeMap} found
 * @param {string} wanted The parameters of the map.
 * @param {boolean} again Whether to load the map anew if shapes were stored or deleted meanwhile.
 */
async function drawSheet({ shapes, version }, wanted, again) {
  for (let before = Infinity, left = shapes.length; left > 0 && left < before;) {
    const answer = await ask(address("map/thumbnails.png", parametersOf(form)));
    const sheet = await answer.blob();
    if (wanted !== shown) return;
    // A shape was stored or deleted meanwhile.
    if (!answer.headers.get("ETag")?.includes(`"${version}-`)) return again ? load(false) : undefined;
    [before, left] = [left, Number(answer.headers.get("Isoshape-Missing"))];
    const former = url;
    url = URL.createObjectURL(sheet);
    list.style.setProperty("--sheet", `url("${url}")`);
    list.dataset.missing = String(left);
    URL.revokeObjectURL(former);
  }
}

/** @param {ShapeMap} found */
function show(found) {
  const { shapes, total } = found;
  size = Math.max(1, found.size);
  cells.clear();
  delete list.dataset.missing;
  list.replaceChildren(...shapes.map(({ id, name, column, row }, number) => {
    const link = make("a", { href: linkTo("find", { shape_id: id }), title: name, ariaLabel: `Find similar to ${name}`, tabIndex: -1 });
    link.style.backgroundPosition = `${share(number % size)} ${share(Math.floor(number / size))}`;
    link.dataset.shape = id;
    link.dataset.cell = `${column} ${row}`;
    cells.set(link.dataset.cell, link);
    const item = make("li", {}, link);
    item.style.gridArea = `${row + 1} / ${column + 1}`;
    return item;
  }));
  const first = list.querySelector("a");
  if (first) first.tabIndex = 0;
  status.textContent = shapes.length === 0 ? "No stored shape matches."
    : shapes.length < total ? `${shapes.length} of ${total} shapes, chosen evenly by age; filters choose others. Similar shapes are near each other.`
      : `${countOf(total, "shape")}. Similar shapes are near each other.`;
  zoomTo(0);
}

/**
 * Zoom about the middle of the frame.
 * @param {number} next Width of a cell; 0 fits the map into the frame.
 */
function zoomTo(next) {
  const room = Math.min(frame.clientWidth, frame.clientHeight);
  const middle = [(frame.scrollLeft + frame.clientWidth / 2) / width, (frame.scrollTop + frame.clientHeight / 2) / width];
  width = Math.max(LEAST, Math.min(GREATEST, next || room / size));
  list.style.setProperty("--cell", `${width}px`);
  list.style.setProperty("--size", String(size));
  frame.scrollTo(middle[0] * width - frame.clientWidth / 2, middle[1] * width - frame.clientHeight / 2);
}

/**
 * The nearest cell in a direction, which has a shape.
 * @param {HTMLAnchorElement} from
 * @param {number} right
 * @param {number} down
 */
function next(from, right, down) {
  const [column, row] = (from.dataset.cell ?? "").split(" ").map(Number);
  for (let step = 1; step < size; step++) {
    for (let aside = 0; aside <= step; aside++) {
      for (const side of [aside, -aside]) {
        const found = cells.get(`${column + right * step + Math.abs(down) * side} ${row + down * step + Math.abs(right) * side}`);
        if (found) return found;
      }
    }
  }
  return null;
}

/** @type {Record<string, [number, number]>} */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

list.addEventListener("keydown", (event) => {
  const arrow = ARROWS[event.key];
  const from = event.target;
  if (!arrow || !(from instanceof HTMLAnchorElement) || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  const to = next(from, ...arrow);
  if (!to) return;
  from.tabIndex = -1;
  to.tabIndex = 0;
  to.focus();
});
frame.addEventListener("wheel", (event) => {
  // Without the Ctrl key the wheel scrolls.
  if (!event.ctrlKey) return;
  event.preventDefault();
  zoomTo(width * Math.exp(-event.deltaY * 0.004));
}, { passive: false });
byId("map-in", HTMLButtonElement).addEventListener("click", () => zoomTo(width * STEP));
byId("map-out", HTMLButtonElement).addEventListener("click", () => zoomTo(width / STEP));
byId("map-reset", HTMLButtonElement).addEventListener("click", () => zoomTo(0));
form.addEventListener("change", () => {
  keep(changedIn(form));
  load();
});
form.addEventListener("submit", (event) => event.preventDefault());
