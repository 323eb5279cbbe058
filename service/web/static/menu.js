// The menu of a card: one list of actions, which opens beside the button of any card.

import { address } from "./api.js";
import { button, byId, make } from "./dom.js";

/** @import { Shape } from "./types.js" */

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
