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
  const at = (/** @type {number} */ vertex) => [positions[3 * vertex], positions[3 * vertex + 1], positions[3 * vertex + 2]];
  const normals = new Float64Array(indices.length), angles = new Float64Array(indices.length);
  for (let first = 0; first < indices.length; first += 3) {
    const a = at(indices[first]), b = at(indices[first + 1]), c = at(indices[first + 2]);
    const sides = [unit(minus(b, a)), unit(minus(c, b)), unit(minus(a, c))];
    normals.set(unit(cross(sides[0], sides[1])), first);
    for (let k = 0; k < 3; k++) {
      angles[first + k] = Math.acos(Math.max(-1, Math.min(1, -dot(sides[k], sides[(k + 2) % 3]))));
    }
  }
  /** Corners by their place: vertices of one place may be several. @type {Map<string, number[]>} */
  const places = new Map();
  const meeting = Array.from({ length: positions.length / 3 }, (_, vertex) => {
    const place = at(vertex).join(), corners = places.get(place) ?? [];
    places.set(place, corners);
    return corners;
  });
  indices.forEach((vertex, corner) => meeting[vertex].push(corner));
  const found = new Float32Array(3 * indices.length), sum = [0, 0, 0];
  for (const corners of places.values()) {
    for (const corner of corners) {
      const own = corner - (corner % 3);
      sum.fill(0);
      for (const other of corners.length > MOST ? [corner] : corners) {
        const its = other - (other % 3);
        const cosine = normals[own] * normals[its] + normals[own + 1] * normals[its + 1] + normals[own + 2] * normals[its + 2];
        if (cosine < SHARPEST && other !== corner) continue;
        for (let k = 0; k < 3; k++) sum[k] += angles[other] * normals[its + k];
      }
      found.set(unit(sum), 3 * corner);
    }
  }
  return found;
}

/** @param {number[]} vector */
function unit(vector) {
  const length = Math.sqrt(dot(vector, vector));
  return length > 0 ? [vector[0] / length, vector[1] / length, vector[2] / length] : vector;
}
