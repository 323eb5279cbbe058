// A stored shape as a card with its picture, its link to similar shapes and its menu of actions.

import { address } from "./api.js";
import { button, byId, make } from "./dom.js";
import { day, sizes, textOf } from "./facts.js";
import { linkTo } from "./state.js";

/** @import { Shape } from "./types.js" */

/**
 * A link that searches with a stored shape.
 * @param {Shape} shape
 */
export function similarLink({ id, name }) {
  const link = make("a", { className: "action", href: linkTo("find", { shape_id: id }), ariaLabel: `Find similar to ${name}` }, "Find similar");
  link.dataset.shape = id;
  return link;
}

/**
 * The picture of a shape.
 * @param {string} id
 * @param {string} [size] In pixels, as the service draws them.
 */
export function thumbnail(id, size = "256") {
  const picture = make("img", {
    src: address(`shapes/${id}/thumbnail.png`, { size }), alt: "", loading: "lazy", decoding: "async", width: 256, height: 256,
  });
  // A busy service may refuse; try again once after three seconds.
  picture.addEventListener("error", () => setTimeout(() => (picture.src = picture.src), 3000), { once: true });
  return picture;
}

/**
 * @param {Shape} shape
 * @param {...Node} actions Beside "Find similar".
 */
export function shapeCard(shape, ...actions) {
  const tags = shape.tags.map((tag) => {
    const link = make("a", { href: linkTo("browse", { tag }), ariaLabel: `Show only shapes with the tag ${tag}` }, tag);
    link.dataset.view = "browse";
    return link;
  });
  const entries = Object.entries(shape.metadata).map(([key, value]) => `${key}: ${textOf(value)}`);
  const about = [day(shape.created_at), ...entries].join(" · ");
  return make(
    "li", {},
    thumbnail(shape.id),
    make("a", { className: "name", href: address(`shapes/${shape.id}/view`) }, shape.name),
    make("p", { className: "size" }, sizes(shape)),
    make("p", { className: "about", title: about }, about),
    make("div", { className: "tags" }, ...tags),
    make("div", { className: "buttons" }, similarLink(shape), ...actions),
  );
}

const menu = byId("card-menu", HTMLElement);

/** @type {HTMLButtonElement | null} */
let opener = null;

/**
 * The button that opens the menu of a shape.
 * @param {Shape} shape
 * @param {((from: HTMLButtonElement) => void) | null} remove Deletes the shape; null where that is not allowed.
 */
export function menuButton(shape, remove) {
  const own = button("⋯", () => {
    opener = own;
    const actions = [
      make("a", { className: "action", href: address(`shapes/${shape.id}/view`) }, "Open"),
      make("a", { className: "action", href: address(`shapes/${shape.id}/file`), download: shape.name }, "Download"),
    ];
    const erase = remove && button("Delete", () => {
      menu.hidePopover();
      remove(own);
    });
    menu.setAttribute("aria-label", `Actions for ${shape.name}`);
    menu.replaceChildren(...actions, ...(erase ? [erase] : []));
  }, `Menu of ${shape.name}`);
  own.className = "menu";
  own.popoverTargetElement = menu;
  return own;
}

menu.addEventListener("toggle", (event) => {
  if (event.newState !== "open" || !opener) return;
  const place = opener.getBoundingClientRect();
  const { offsetWidth: width, offsetHeight: height } = menu;
  const below = place.bottom + height + 8 < innerHeight;
  menu.style.left = `${Math.max(8, place.right - width)}px`;
  menu.style.top = `${below ? place.bottom + 4 : Math.max(8, place.top - height - 4)}px`;
});
// The menu does not follow the card.
addEventListener("scroll", () => menu.matches(":popover-open") && menu.hidePopover(), { passive: true });
