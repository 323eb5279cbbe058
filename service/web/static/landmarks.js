// Landmarks of two shapes: points of the first, and where the service finds them on the second.

import { address, askWith } from "./api.js";
import { saveTable } from "./csv.js";
import { byId, button, make, showError } from "./dom.js";
import { inFile, placed } from "./glb.js";

/** @import { View } from "./stage.js" */
/** @import { Compared } from "./types.js" */

/**
 * `second` is the place on the second shape; `set` tells whether the user has set it.
 * @typedef {object} Landmark
 * @property {number[]} first
 * @property {number[] | null} second
 * @property {boolean} set
 * @property {number | null} confidence
 * @property {HTMLInputElement} name
 * @property {HTMLElement} told
 */

/** The most landmarks that a comparison takes. */
const MOST = 64;

/** How far a pointer may move in a click, in CSS pixels. */
const STILL = 4;

/**
 * Call a function with each point of a shape that is clicked, in the coordinates of its model.
 * @param {View} view
 * @param {(point: number[]) => void} act
 */
function onClick(view, act) {
  const { canvas } = view;
  let from = { x: NaN, y: NaN };
  canvas.addEventListener("pointerdown", ({ clientX, clientY }) => (from = { x: clientX, y: clientY }));
  canvas.addEventListener("click", ({ clientX, clientY }) => {
    if (Math.hypot(clientX - from.x, clientY - from.y) > STILL) return;
    const box = canvas.getBoundingClientRect();
    const point = view.surfaceAt(clientX - box.left, clientY - box.top);
    if (point) act(point);
  });
}

/**
 * Let landmarks be placed on two shapes.
 * @param {[View, View]} views
 * @param {[string, string]} ids
 * @param {[string, string]} names
 */
export function offerLandmarks([one, other], [first, second], names) {
  const list = byId("landmark-list", HTMLOListElement);
  const exporting = byId("landmarks-export", HTMLButtonElement);
  const error = byId("landmarks-error", HTMLElement);
  const status = byId("landmarks-status", HTMLElement);
  /** @type {Landmark[]} */
  let landmarks = [];
  /** The landmark whose partner a click on the second shape sets. @type {Landmark | undefined} */
  let current;
  let asking = new AbortController();

  function show() {
    one.pin(landmarks.map((each) => placed(one.model, each.first)));
    other.pin(landmarks.flatMap((each) => each.second ? [placed(other.model, each.second)] : []));
    for (const { told, set, confidence } of landmarks) {
      told.textContent = set ? "set by hand" : confidence === null ? "" : `confidence ${confidence.toFixed(2)}`;
    }
    exporting.disabled = !landmarks.length || landmarks.some((each) => !each.second);
  }

  /** Ask for the places of all landmarks on the second shape. */
  async function transfer() {
    asking.abort();
    asking = new AbortController();
    showError(error);
    show();
    const asked = landmarks;
    if (asked.length === 0) return;
    const fixed = asked.filter((each) => each.set).map((each) => ({ first: each.first, second: each.second }));
    const body = {
      first, second, transfer: { points: asked.map((each) => each.first) },
      ...(fixed.length ? { landmarks: fixed } : {}),
    };
    status.textContent = "Looking for the landmarks on the other shape";
    const { signal } = asking;
    try {
      /** @type {Compared} */
      const { maps, transferred } = await askWith(address("compare"), body, signal);
      for (const [i, landmark] of asked.entries()) {
        if (landmark.set) continue;
        landmark.second = transferred.points[i].position;
        landmark.confidence = transferred.points[i].confidence;
      }
      status.textContent = maps > 1
        ? `${maps} maps fit about equally well: a few landmarks set by hand on the second shape tell them apart.` : "";
      show();
    } catch (reason) {
      if (signal.aborted) return;
      status.textContent = "";
      showError(error, reason);
    }
  }

  /** @param {number[]} place On the first shape, in the coordinates of its file. */
  function add(place) {
    if (landmarks.length >= MOST) return showError(error, new Error(`A comparison takes at most ${MOST} landmarks.`));
    const number = landmarks.length + 1;
    const name = make("input", { type: "text", value: `landmark ${number}`, maxLength: 255, ariaLabel: "Name of the landmark" });
    const told = make("span", {});
    /** @type {Landmark} */
    const landmark = { first: place, second: null, set: false, confidence: null, name, told };
    const item = make("li", { className: "buttons" }, name, told, button("Remove", () => {
      landmarks = landmarks.filter((each) => each !== landmark);
      if (current === landmark) current = landmarks.at(-1);
      item.remove();
      transfer();
    }));
    item.addEventListener("focusin", () => (current = landmark));
    list.append(item);
    landmarks = [...landmarks, landmark];
    current = landmark;
    transfer();
  }

  onClick(one, (point) => add(inFile(one.model, point)));
  onClick(other, (point) => {
    if (!current) return;
    Object.assign(current, { second: inFile(other.model, point), set: true, confidence: null });
    transfer();
  });
  exporting.addEventListener("click", () => saveTable(`landmarks of ${names[0]} and ${names[1]}.csv`, [
    ["name", "x", "y", "z", "x2", "y2", "z2", "confidence"],
    ...landmarks.map((each) => [each.name.value, ...each.first, ...(each.second ?? []), each.confidence]),
  ]));
  byId("landmarks", HTMLElement).hidden = false;
  show();
}
