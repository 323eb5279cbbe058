// Normals for smooth shading that keep sharp edges sharp.

import { cross, dot, minus } from "./glb.js";

/** @import { Model } from "./glb.js" */

// A cylinder of twelve sides looks round, and a prism of eight sides has edges.
const SHARPEST = Math.cos((38 * Math.PI) / 180);
// The tip of a fan has more triangles; each of them has the normal of its plane there.
const MOST = 64;

/**
 * The normal at each corner of each triangle: the mean over the triangles that meet there and whose planes are at most
 * 38 degrees from its own, each weighted by its angle at the corner, so that the triangulation of a plane does not count.
 * @param {Pick<Model, "positions" | "indices">} model
 */
export function cornerNormals({ positions, indices }) {
  const at = (/** @type {number} */ corner) => positions.subarray(3 * indices[corner], 3 * indices[corner] + 3);
  const normals = new Float64Array(indices.length), angles = new Float64Array(indices.length);
  for (let first = 0; first < indices.length; first += 3) {
    const corners = [at(first), at(first + 1), at(first + 2)];
    const normal = unit(cross(minus(corners[1], corners[0]), minus(corners[2], corners[0])));
    normals.set(normal, first);
    for (let k = 0; k < 3; k++) {
      const one = unit(minus(corners[(k + 1) % 3], corners[k])), two = unit(minus(corners[(k + 2) % 3], corners[k]));
      angles[first + k] = Math.acos(Math.max(-1, Math.min(1, dot(one, two))));
    }
  }
  /** Corners by their place: vertices of one place may be several. @type {Map<string, number[]>} */
  const meeting = new Map();
  for (let corner = 0; corner < indices.length; corner++) {
    const place = at(corner).join();
    const known = meeting.get(place);
    if (known) known.push(corner);
    else meeting.set(place, [corner]);
  }
  const found = new Float32Array(3 * indices.length);
  for (const corners of meeting.values()) {
    for (const corner of corners) {
      const plane = 3 * Math.floor(corner / 3), own = normals.subarray(plane, plane + 3), sum = [0, 0, 0];
      for (const other of corners.length > MOST ? [corner] : corners) {
        const start = 3 * Math.floor(other / 3), normal = normals.subarray(start, start + 3);
        if (dot(own, normal) < SHARPEST && other !== corner) continue;
        for (let k = 0; k < 3; k++) sum[k] += angles[other] * normal[k];
      }
      found.set(unit(sum), 3 * corner);
    }
  }
  return found;
}

/** @param {number[]} vector */
function unit(vector) {
  const length = Math.hypot(...vector);
  return length > 0 ? vector.map((value) => value / length) : vector;
}
