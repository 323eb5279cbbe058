// Preview meshes of the service: one primitive, positions in -1 to 1.

/**
 * @typedef {object} Model
 * @property {Float32Array} positions
 * @property {Uint32Array} indices
 * @property {number[]} matrix Columns of the 4 by 4 matrix to the scene, whose y axis points up.
 * @property {number[]} middle A point p of the file is stored as (p - middle) / half.
 * @property {number} half
 */

/**
 * Read the mesh of a preview.
 * @param {ArrayBuffer} data
 * @returns {Model}
 */
export function readGlb(data) {
  const { tree, bytes } = opened(data);
  return modelOf(data, tree, bytes, tree.nodes[0]);
}

/**
 * @param {ArrayBuffer} data
 * @param {any} tree
 * @param {(number: number) => [number, number]} bytes
 * @param {any} node
 * @returns {Model}
 */
function modelOf(data, tree, bytes, node) {
  const primitive = tree.meshes[node.mesh].primitives[0];
  const [points, pointBytes] = bytes(primitive.attributes.POSITION);
  const [faces, faceBytes] = bytes(primitive.indices);
  return {
    positions: new Float32Array(data, points, pointBytes / 4),
    indices: new Uint32Array(data, faces, faceBytes / 4),
    matrix: node.matrix,
    middle: node.extras.middle,
    half: node.extras.half,
  };
}

/**
 * How two shapes differ: `distance`, after an alignment that may be that of a registered copy or variant, with
 * the end of the scale; or `stretch`, of bodies that bend.
 * @typedef {object} Extras
 * @property {string} quantity
 * @property {boolean} [registered]
 * @property {number} [maximum]
 * @property {number} [size] That of the second over that of the first; both are compared in one size.
 * @property {number} [without_partner]
 */

/**
 * One painted mesh of a comparison.
 * @typedef {object} Painting
 * @property {Model} model
 * @property {Float32Array} colours Red, green and blue of each vertex, from 0 to 1.
 * @property {Extras} extras
 */

/**
 * Read all meshes of a comparison, each where the service places it by itself: at the origin.
 * @param {ArrayBuffer} data
 * @returns {Painting[]}
 */
export function readPaintings(data) {
  const { tree, bytes } = opened(data);
  return tree.nodes.map((/** @type {any} */ node) => {
    const [start, length] = bytes(tree.meshes[node.mesh].primitives[0].attributes.COLOR_0);
    const stored = new Uint8Array(data, start, length);
    const colours = new Float32Array((length / 4) * 3);
    for (let i = 0; i < colours.length; i++) colours[i] = stored[4 * Math.floor(i / 3) + (i % 3)] / 255;
    const model = modelOf(data, tree, bytes, node);
    return { model: { ...model, matrix: [...model.matrix.slice(0, 12), 0, 0, 0, 1] }, colours, extras: node.extras };
  });
}

/**
 * The tree of a file, and a function that finds the first byte and the length of an accessor.
 * @param {ArrayBuffer} data
 */
function opened(data) {
  const view = new DataView(data);
  if (view.getUint32(0, true) !== 0x46546c67) throw new Error("The service sent no mesh.");
  const length = view.getUint32(12, true);
  const tree = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 20, length)));
  /** @param {number} number @returns {[number, number]} */
  const bytes = (number) => {
    const { byteOffset, byteLength } = tree.bufferViews[tree.accessors[number].bufferView];
    return [28 + length + byteOffset, byteLength];
  };
  return { tree, bytes };
}

/**
 * Transform a point of the file to the coordinates of the model.
 * @param {Model} model
 * @param {number[]} point
 */
export const placed = (model, point) => point.map((value, axis) => (value - model.middle[axis]) / model.half);

/**
 * Transform a point of the model to the coordinates of the file.
 * @param {Model} model
 * @param {number[]} point
 */
export const inFile = (model, point) => point.map((value, axis) => value * model.half + model.middle[axis]);

/**
 * The first point of a model on a ray, after Möller and Trumbore (1997); null if the ray meets no triangle.
 * @param {Model} model
 * @param {number[]} from
 * @param {number[]} along The direction.
 */
export function firstOnRay({ positions, indices }, from, along) {
  let nearest = Infinity;
  for (let i = 0; i < indices.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => positions.subarray(3 * indices[i + k], 3 * indices[i + k] + 3));
    const one = minus(b, a), two = minus(c, a), away = minus(from, a);
    const normal = cross(along, two);
    const determinant = dot(one, normal);
    if (determinant === 0) continue;
    const u = dot(away, normal) / determinant;
    const turned = cross(away, one);
    const v = dot(along, turned) / determinant;
    const far = dot(two, turned) / determinant;
    if (u >= 0 && v >= 0 && u + v <= 1 && far > 0 && far < nearest) nearest = far;
  }
  return nearest === Infinity ? null : from.map((value, axis) => value + nearest * along[axis]);
}

/** @typedef {number[] | Float32Array | Float64Array} Three */

/** @param {Three} a @param {Three} b */
export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
/** @param {Three} a @param {Three} b */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @param {Three} a @param {Three} b */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
