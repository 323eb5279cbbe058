// Where the query and a result differ: colours that the service computes, and words for them.

import { address, ask } from "./api.js";
import { readPaintings } from "./glb.js";

/** @import { Painting } from "./glb.js" */

/**
 * The paintings of two shapes, each an id or a file.
 * @param {string | File} first
 * @param {string | File} second
 */
export async function differences(first, second) {
  const form = new FormData();
  form.append("first", first);
  form.append("second", second);
  const where = address("compare", { dense: "true", format: "glb", paint: "difference" });
  return readPaintings(await (await ask(where, { method: "POST", body: form })).arrayBuffer());
}

/**
 * Such as "Brown: 0.64 in the units of the file; 8 % of its vertices correspond to none".
 * @param {Painting} painting
 */
export function told({ extras }) {
  const { quantity, maximum, without_partner: without } = extras;
  const most = quantity === "displacement"
    ? `Brown: ${Number(maximum.toPrecision(2))} in the units of the file`
    : "Brown: twice or half as long as elsewhere";
  return without > 0.0005 ? `${most}; ${Math.max(1, Math.round(100 * without))} % of its vertices correspond to none` : most;
}
