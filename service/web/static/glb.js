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
 * Read the first primitive of a preview.
 * @param {ArrayBuffer} data
 * @returns {Model}
 */
export function readGlb(data) {
  const view = new DataView(data);
  if (view.getUint32(0, true) !== 0x46546c67) throw new Error("The service sent no mesh.");
  const length = view.getUint32(12, true);
  const tree = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 20, length)));
  const start = 28 + length;
  const node = tree.nodes[0];
  const primitive = tree.meshes[node.mesh].primitives[0];
  /** @param {number} number @returns {[number, number]} First byte and length of an accessor. */
  const bytes = (number) => {
    const { byteOffset, byteLength } = tree.bufferViews[tree.accessors[number].bufferView];
    return [start + byteOffset, byteLength];
  };
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
 * Transform a point of the file to the coordinates of the model.
 * @param {Model} model
 * @param {number[]} point
 */
export const placed = (model, point) => point.map((value, axis) => (value - model.middle[axis]) / model.half);
