// The axis of the files that points up in all drawings: that of each format, or one that is chosen and kept.

import { make } from "./dom.js";
import { Matrix4, Vector3 } from "./vendor/three.js";

/** @import { Quaternion } from "./vendor/three.js" */
/** @import { Model } from "./glb.js" */

const KEPT = "up";
const UP = new Vector3(0, 1, 0);

/** @type {Record<string, Vector3>} */
const AXES = {
  "+X": new Vector3(1, 0, 0), "-X": new Vector3(-1, 0, 0), "+Y": UP, "-Y": new Vector3(0, -1, 0),
  "+Z": new Vector3(0, 0, 1), "-Z": new Vector3(0, 0, -1),
};

/** The axis that is chosen; empty for that of each format, also where the browser keeps nothing. */
export function keptAxis() {
  try {
    const axis = localStorage.getItem(KEPT) ?? "";
    return axis in AXES ? axis : "";
  } catch {
    return "";
  }
}

/**
 * Set the turn that brings an axis of the file up, of a drawing that is upright by the format.
 * @param {Quaternion} turn
 * @param {Model} model
 * @param {string} axis
 */
export function bringUp(turn, model, axis) {
  if (!(axis in AXES)) return turn.identity();
  const format = turn.clone().setFromRotationMatrix(new Matrix4().fromArray(model.matrix));
  return turn.setFromUnitVectors(AXES[axis], UP).multiply(format.invert());
}

/**
 * Offer the axes.
 * @param {HTMLSelectElement} choice
 * @param {(axis: string) => void} apply
 */
export function offerAxes(choice, apply) {
  const own = make("option", { value: "", title: "the axis of each format" }, "auto");
  choice.append(own, ...Object.keys(AXES).map((axis) => make("option", {}, axis)));
  choice.value = keptAxis();
  choice.addEventListener("change", () => {
    try {
      localStorage.setItem(KEPT, choice.value);
    } catch {
      // The choice lasts as long as the page.
    }
    apply(choice.value);
  });
}
