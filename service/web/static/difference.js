// Where each result differs from the query: painted, side by side, or one over the other.

import { address, ask, formWith } from "./api.js";
import { sizeIsTold } from "./card.js";
import { byId, make } from "./dom.js";
import { readPaintings } from "./glb.js";
import { PLAIN } from "./matching.js";

/** @import { Side } from "./comparison.js" */
/** @import { Painting } from "./glb.js" */
/** @import { Colour } from "./matching.js" */

/**
 * The paintings of two shapes, each an id or a file.
 * @param {string | File} first
 * @param {string | File} second
 */
async function paintings(first, second) {
  const body = formWith({ first, second });
  const where = address("compare", { dense: "true", format: "glb", paint: "difference" });
  return readPaintings(await (await ask(where, { method: "POST", body })).arrayBuffer());
}

/**
 * Such as "Brown: 0.64 in the unit of the query".
 * @param {Painting} painting
 */
function told({ extras }) {
  const { quantity, registered, maximum = 0, size = 1, without_partner: without = 0 } = extras;
  if (quantity === "distance") {
    const equal = sizeIsTold(size) ? ", at equal size" : "";
    const most = (maximum > 0 ? `Brown: ${Number(maximum.toPrecision(3))} in the unit of the query`
      : "No difference beyond the errors of the meshes") + equal;
    return registered ? most : `Neither a copy nor a variant; laid on the query as well as it fits. ${most}`;
  }
  const most = "Bent. Brown: twice or half as long as elsewhere";
  return without > 0.0005 ? `${most}; ${Math.max(1, Math.round(100 * without))} % of its vertices correspond to none` : most;
}

/** @param {Painting} painting @returns {Painting} */
function plain({ model, extras, colours }) {
  return { model, extras, colours: colours.map((_, i) => PLAIN[i % 3]) };
}

/** Grey that means nothing yet: the scale begins lighter. @type {Colour} */
const WAITING = [0.62, 0.62, 0.62];

/** How differences are shown, and the share of the result where both are laid over each other. */
const choice = { as: "painted", share: 0.5 };

/** The differences of the results from a query. */
export class Differences {
  /** @param {Side[]} sides The query first. */
  constructor(sides) {
    this.sides = sides;
    this.shown = false;
    /** @type {(Painting[] | undefined)[]} */
    this.found = [];
  }

  /** Show the shapes as they are. */
  hide() {
    this.shown = false;
    for (const { view, shown } of this.sides) {
      shown.explain?.("");
      view.overlay([]);
    }
  }

  /** Ask for each result's difference from the query, one after the other, and show it. */
  async show() {
    this.shown = true;
    const [query, ...results] = this.sides;
    const given = query.shown.given;
    if (given === undefined) return;
    const asked = results.map((side, i) => this.found[i] ? null : waiting(side));
    if (!this.found[0]) query.view.paint(WAITING);
    try {
      for (const [i, { shown }] of results.entries()) {
        if (shown.given === undefined) continue;
        this.found[i] ??= await paintings(given, shown.given);
        asked[i]?.remove();
        this.sides[i + 1].view.canvas.removeAttribute("aria-busy");
        // Another colouring may have been chosen meanwhile.
        if (!this.shown) return;
        this.draw(i);
      }
    } finally {
      for (const bar of asked) bar?.remove();
      for (const { view } of results) view.canvas.removeAttribute("aria-busy");
    }
  }

  /** @param {number} i */
  draw(i) {
    const painted = this.found[i];
    if (!painted) return;
    const [query, ...results] = this.sides;
    const [one, other] = choice.as === "side" ? painted.map(plain) : painted;
    const { view, shown } = results[i];
    // Bodies that bend stay each in its own frame.
    const aligned = other.extras.quantity === "distance";
    const layers = [{ ...other, weight: 1 }];
    if (choice.as === "overlay" && aligned) layers.unshift({ ...one, weight: 1 });
    view.overlay(layers, aligned ? query.view : view);
    this.blend();
    shown.explain?.(told(other));
    if (i > 0) return;
    query.view.overlay([{ ...one, weight: 1 }]);
  }

  /** Draw all again. */
  redraw() {
    if (this.shown) for (const i of this.found.keys()) this.draw(i);
  }

  /** Weigh the layers of each overlay. */
  blend() {
    for (const { view } of this.sides) if (view.layers.length === 2) view.weigh([1 - choice.share, choice.share]);
  }
}

/**
 * Let the controls of the page choose how differences are shown.
 * @param {() => Differences | undefined} current
 */
export function listen(current) {
  const as = byId("difference-as", HTMLSelectElement), blend = byId("blend", HTMLInputElement);
  const scale = byId("difference-scale", HTMLElement), over = byId("blending", HTMLElement);
  const choose = () => {
    choice.as = as.value;
    scale.hidden = as.value === "side";
    over.hidden = as.value !== "overlay";
    current()?.redraw();
  };
  as.addEventListener("change", choose);
  blend.addEventListener("input", () => {
    choice.share = Number(blend.value);
    current()?.blend();
  });
  choose();
  choice.share = Number(blend.value);
}

/** Show that a result's difference is being computed. @param {Side} side */
function waiting({ view, shown }) {
  view.paint(WAITING);
  view.canvas.setAttribute("aria-busy", "true");
  const bar = make("progress", { ariaLabel: `The difference of ${shown.name} from the query is computed` });
  view.canvas.after(bar);
  return bar;
}
