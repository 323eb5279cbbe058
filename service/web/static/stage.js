// Shapes side by side that rotate together: one camera, one WebGL context, one canvas for each shape.

import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, Group, InstancedMesh, Matrix4,
  Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Scene, SphereGeometry, Vector3, WebGLRenderer,
} from "./vendor/three.js";
import { firstOnRay } from "./glb.js";
import { cornerNormals } from "./shading.js";
import { bringUp, keptAxis } from "./up.js";

/** @import { Model } from "./glb.js" */
/** @import { Colour } from "./matching.js" */

// The same values as in service/rendering/thumbnail.py.
const ELEVATION = 18, AZIMUTH = 28;
const RADIANS = Math.PI / 180;
const FIELD_OF_VIEW = 30;
const DOT_RADIUS = 0.028;
const PICK_DISTANCE = 14;

/** The matrix from the coordinates of a model to those of its file. @param {Model} model */
const toFile = ({ middle: [x, y, z], half }) => new Matrix4().makeScale(half, half, half).setPosition(x, y, z);

/** @typedef {{ group: Group, weight: number }} Layer */
/** @typedef {{ radius: number, middle: Vector3, frame: Model }} Seen */

const surface = new MeshLambertMaterial({ vertexColors: true, side: DoubleSide });

/** @param {Model} model */
function placedGroup(model) {
  const group = new Group();
  group.matrixAutoUpdate = false;
  group.matrix.fromArray(model.matrix);
  return group;
}

/** The values of vertices, three each, at the corners of the triangles. @param {Float32Array} values @param {Model} model */
function atCorners(values, { indices }) {
  const each = new Float32Array(3 * indices.length);
  for (let i = 0; i < each.length; i++) each[i] = values[3 * indices[Math.floor(i / 3)] + (i % 3)];
  return each;
}

/** @param {Model} model */
function geometryOf(model) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(atCorners(model.positions, model), 3));
  geometry.setAttribute("normal", new BufferAttribute(cornerNormals(model), 3));
  geometry.computeBoundingSphere();
  return geometry;
}

/**
 * The distance of the farthest vertex from a point.
 * @param {Model} model
 * @param {Vector3} middle
 * @param {Matrix4} [matrix] Where the model is drawn.
 */
function reach({ positions, matrix: own }, middle, matrix = new Matrix4().fromArray(own)) {
  const at = new Vector3();
  let most = 0;
  for (let i = 0; i < positions.length; i += 3) {
    most = Math.max(most, at.fromArray(positions, i).applyMatrix4(matrix).distanceTo(middle));
  }
  return most;
}

/** @param {BufferGeometry} geometry @param {Model} model @param {Float32Array} colours Red, green and blue of each vertex. */
function setColours(geometry, model, colours) {
  const linear = new Color();
  const stored = new Float32Array(colours.length);
  for (let i = 0; i < stored.length; i += 3) linear.setRGB(colours[i], colours[i + 1], colours[i + 2], "srgb").toArray(stored, i);
  geometry.setAttribute("color", new BufferAttribute(atCorners(stored, model), 3));
}

/** One shape on its canvas. */
export class View {
  /**
   * @param {Stage} stage
   * @param {HTMLCanvasElement} canvas
   * @param {Model} model
   */
  constructor(stage, canvas, model) {
    this.stage = stage;
    this.canvas = canvas;
    this.model = model;
    this.scene = new Scene();
    this.group = placedGroup(model);
    this.light = new DirectionalLight(0xffffff, 2.2);
    this.scene.add(this.group, this.light, new AmbientLight(0xffffff, 1.1));
    this.geometry = geometryOf(model);
    this.radius = this.geometry.boundingSphere?.radius || 1;
    this.middle = (this.geometry.boundingSphere?.center ?? new Vector3()).applyMatrix4(this.group.matrix);
    /** The model of the file whose axes the drawing has. */
    this.frame = model;
    /** What the camera looks at: the shape, or what is drawn in its place. @type {Seen} */
    this.seen = this;
    this.group.add(new Mesh(this.geometry, surface));
    /** What is drawn one over the other, each by its weight. @type {Layer[]} */
    this.layers = [{ group: this.group, weight: 1 }];
    /** @type {Vector3[]} */
    this.points = [];
    /** @type {InstancedMesh | null} */
    this.dots = null;
    this.marks = new Group();
    this.pins = new Group();
    this.group.add(this.marks, this.pins);
    /** @type {number[]} */
    this.marked = [];
  }

  /**
   * Draw the shape in the frame of another one.
   * @param {View} other
   * @param {number[][]} transform Four rows: from the file of the shape to that of the other one.
   * @param {boolean} mirrored Whether the shape is to be seen as the mirror image of the other one, left for right.
   */
  place(other, transform, mirrored) {
    const { matrix } = this.group;
    const between = new Matrix4().fromArray(transform.flat()).transpose();
    matrix.copy(toFile(other.model).invert()).multiply(between).multiply(toFile(this.model));
    if (mirrored) matrix.premultiply(new Matrix4().makeScale(-1, 1, 1));
    matrix.premultiply(other.group.matrix);
    this.frame = other.model;
    this.middle = other.middle;
    // A variant may be larger.
    this.radius = Math.max(other.radius, reach(this.model, other.middle, matrix));
    this.turn(this.stage.up);
  }

  /** @param {string} axis The axis of the file that points up; empty for that of its format. */
  turn(axis) {
    bringUp(this.scene.quaternion, this.seen.frame, axis);
    this.stage.changed();
  }

  /**
   * @param {Float32Array | Colour} colours One colour for each vertex, or one for all.
   */
  paint(colours) {
    const each = colours instanceof Float32Array ? colours : new Float32Array(this.model.positions.length);
    if (!(colours instanceof Float32Array)) for (let i = 0; i < each.length; i++) each[i] = colours[i % 3];
    setColours(this.geometry, this.model, each);
    this.stage.changed();
  }

  /**
   * Draw other meshes in the place of the shape, or itself if there are none.
   * @param {{ model: Model, colours: Float32Array, weight: number }[]} meshes
   * @param {View} [other] The view in whose frame they are.
   */
  overlay(meshes, other = this) {
    for (const { group } of this.layers) {
      if (group === this.group) continue;
      this.scene.remove(group);
      for (const mesh of group.children) if (mesh instanceof Mesh) mesh.geometry.dispose();
    }
    this.layers = meshes.map(({ model, colours, weight }) => {
      const group = placedGroup(model), geometry = geometryOf(model);
      setColours(geometry, model, colours);
      this.scene.add(group.add(new Mesh(geometry, surface)));
      group.visible = false;
      return { group, weight };
    });
    if (meshes.length === 0) this.layers = [{ group: this.group, weight: 1 }];
    this.seen = this;
    if (other !== this) {
      // A part of another size is drawn whole, too.
      const radius = Math.max(...meshes.map(({ model }) => reach(model, other.middle)));
      this.seen = { radius: Math.max(other.radius, radius), middle: other.middle, frame: other.frame };
    }
    this.turn(this.stage.up);
  }

  /** @param {number[]} weights The share of each layer in the picture. */
  weigh(weights) {
    for (const [i, weight] of weights.entries()) this.layers[i].weight = weight;
    this.stage.changed();
  }

  /**
   * @param {number[][]} points In the coordinates of the model.
   * @param {Colour[]} colours
   * @param {boolean[]} large Whether each dot is drawn in full size.
   */
  setPoints(points, colours, large) {
    this.points = points.map(([x, y, z]) => new Vector3(x, y, z));
    const dots = new InstancedMesh(new SphereGeometry(1, 10, 8), new MeshBasicMaterial(), points.length);
    const colour = new Color();
    for (const [i, point] of this.points.entries()) {
      const size = DOT_RADIUS * this.radius * (large[i] ? 1 : 0.55);
      dots.setMatrixAt(i, new Matrix4().makeScale(size, size, size).setPosition(point));
      dots.setColorAt(i, colour.setRGB(...colours[i], "srgb"));
    }
    dots.frustumCulled = false;
    if (this.dots) this.group.remove(this.dots);
    this.dots = dots;
    this.group.add(dots);
    this.stage.changed();
  }

  /** @param {boolean} shown */
  showPoints(shown) {
    if (this.dots) this.dots.visible = shown;
    this.stage.changed();
  }

  /** @param {number[]} numbers The points to mark. */
  mark(numbers) {
    this.marked = numbers;
    this.balls(this.marks, numbers.map((number) => this.points[number]), 0xffd400);
  }

  /** @param {number[][]} points Landmarks to mark, in the coordinates of the model. */
  pin(points) {
    this.balls(this.pins, points.map(([x, y, z]) => new Vector3(x, y, z)), 0xe0417f);
  }

  /** @param {Group} group @param {Vector3[]} points @param {number} inner The colour within a black rim. */
  balls(group, points, inner) {
    group.clear();
    for (const point of points) {
      const size = 2.6 * DOT_RADIUS * this.radius;
      for (const [scale, colour] of [[1, 0x000000], [0.8, inner]]) {
        // Visible through the surface, the bright ball in front.
        const material = new MeshBasicMaterial({ color: colour, depthTest: false, transparent: true });
        const ball = new Mesh(new SphereGeometry(size * scale, 14, 10), material);
        ball.renderOrder = scale < 1 ? 2 : 1;
        ball.position.copy(point);
        group.add(ball);
      }
    }
    this.stage.changed();
  }

  /**
   * The visible point nearest to a position on the canvas; -1 if there is none.
   * @param {number} x
   * @param {number} y In CSS pixels from the top left corner.
   */
  pointAt(x, y) {
    const { width, height } = this.canvas.getBoundingClientRect();
    this.stage.aim(this);
    let best = -1, nearest = Infinity;
    const at = new Vector3();
    for (const [i, point] of this.points.entries()) {
      at.copy(point).applyMatrix4(this.group.matrix).applyQuaternion(this.scene.quaternion).project(this.stage.camera);
      const distance = Math.hypot(((at.x + 1) / 2) * width - x, ((1 - at.y) / 2) * height - y);
      // Prefers the point in front among points at about the same distance.
      const cost = distance / PICK_DISTANCE + 40 * at.z;
      if (distance <= PICK_DISTANCE && cost < nearest) [best, nearest] = [i, cost];
    }
    return best;
  }

  /**
   * The point of the surface at a position on the canvas, in the coordinates of the model; null beside it.
   * @param {number} x
   * @param {number} y In CSS pixels from the top left corner.
   */
  surfaceAt(x, y) {
    const { width, height } = this.canvas.getBoundingClientRect();
    this.stage.aim(this);
    const turned = this.scene.quaternion.clone().invert(), own = this.group.matrix.clone().invert();
    const [near, far] = [-1, 1].map((depth) => new Vector3((2 * x) / width - 1, 1 - (2 * y) / height, depth)
      .unproject(this.stage.camera).applyQuaternion(turned).applyMatrix4(own));
    return firstOnRay(this.model, near.toArray(), far.sub(near).toArray());
  }
}

/** All views and their camera. */
export class Stage {
  constructor() {
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true });
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 100);
    /** @type {View[]} */
    this.views = [];
    this.autoRotate = false;
    this.waiting = false;
    this.azimuth = AZIMUTH * RADIANS;
    this.elevation = ELEVATION * RADIANS;
    this.zoom = 1;
    this.up = keptAxis();
    this.sizes = new ResizeObserver(() => this.changed());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.changed());
  }

  /** Reset the camera. */
  reset() {
    this.azimuth = AZIMUTH * RADIANS;
    this.elevation = ELEVATION * RADIANS;
    this.zoom = 1;
    this.changed();
  }

  /** Remove all views. */
  clear() {
    this.sizes.disconnect();
    for (const view of this.views) view.geometry.dispose();
    this.views = [];
  }

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Model} model
   */
  add(canvas, model) {
    const view = new View(this, canvas, model);
    this.views.push(view);
    view.turn(this.up);
    this.sizes.observe(canvas);
    this.listen(view);
    return view;
  }

  /** @param {number} across @param {number} up In radians. */
  rotate(across, up) {
    this.azimuth += across;
    this.elevation = Math.max(-1.5, Math.min(1.5, this.elevation + up));
    this.changed();
  }

  /** @param {string} axis The axis of the files that points up; empty for that of each format. */
  setUp(axis) {
    this.up = axis;
    for (const view of this.views) view.turn(axis);
  }

  /** @param {number} factor */
  zoomBy(factor) {
    this.zoom = Math.max(0.3, Math.min(8, this.zoom * factor));
    this.changed();
  }

  /** @param {boolean} on Whether the shapes rotate slowly. */
  setAutoRotate(on) {
    this.autoRotate = on;
    this.changed();
  }

  /** Schedule one redraw. */
  changed() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
      if (this.autoRotate && this.views.length > 0) this.rotate(0.006, 0);
    });
  }

  /** Point the camera at a shape. @param {View} view */
  aim(view) {
    const { camera } = this;
    const distance = (1.05 * view.seen.radius) / Math.sin((FIELD_OF_VIEW / 2) * RADIANS) / this.zoom;
    const level = Math.cos(this.elevation);
    const turn = view.scene.quaternion, middle = view.seen.middle.clone().applyQuaternion(turn);
    camera.position
      .set(level * Math.sin(this.azimuth), Math.sin(this.elevation), level * Math.cos(this.azimuth))
      .multiplyScalar(distance)
      .add(middle);
    camera.near = distance / 50;
    camera.far = distance + 4 * view.seen.radius;
    camera.aspect = view.canvas.clientWidth / Math.max(1, view.canvas.clientHeight);
    camera.lookAt(middle);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    // The light comes from the upper left of the camera.
    view.light.position.set(-0.5, 0.9, 1).applyQuaternion(camera.quaternion).applyQuaternion(turn.clone().invert());
  }

  draw() {
    const sharpness = Math.min(2, devicePixelRatio);
    for (const view of this.views) {
      const { canvas } = view;
      const width = Math.round(canvas.clientWidth * sharpness), height = Math.round(canvas.clientHeight * sharpness);
      if (width === 0 || height === 0) continue;
      if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
      this.renderer.setSize(width, height, false);
      this.aim(view);
      const flat = canvas.getContext("2d");
      flat?.clearRect(0, 0, width, height);
      view.group.visible = false;
      for (const { group, weight } of view.layers) {
        group.visible = true;
        this.renderer.render(view.scene, this.camera);
        group.visible = false;
        // Pictures are added by their weights, so that what they have in common is as opaque as in each.
        if (flat) Object.assign(flat, { globalAlpha: weight, globalCompositeOperation: "lighter" });
        flat?.drawImage(this.renderer.domElement, 0, 0);
      }
      canvas.dataset.drawn = "yes";
    }
  }

  /** Rotate and zoom by pointer and keys. @param {View} view */
  listen({ canvas }) {
    /** @type {Map<number, { x: number, y: number }>} */
    const held = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      held.set(event.pointerId, { x: event.clientX, y: event.clientY });
      canvas.setPointerCapture(event.pointerId);
    });
    for (const end of /** @type {const} */ (["pointerup", "pointercancel"])) {
      canvas.addEventListener(end, (event) => held.delete(event.pointerId));
    }
    canvas.addEventListener("pointermove", (event) => {
      const from = held.get(event.pointerId);
      if (!from || held.size !== 1) return;
      this.rotate((from.x - event.clientX) * 0.01, (event.clientY - from.y) * 0.01);
      held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    });
    canvas.addEventListener("wheel", (event) => {
      // Without the Ctrl key the wheel scrolls the page.
      if (!event.ctrlKey) return;
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY * 0.004));
    }, { passive: false });
    /** @type {Record<string, () => void>} */
    const keys = {
      ArrowLeft: () => this.rotate(-0.12, 0),
      ArrowRight: () => this.rotate(0.12, 0),
      ArrowUp: () => this.rotate(0, 0.12),
      ArrowDown: () => this.rotate(0, -0.12),
      "+": () => this.zoomBy(1.15),
      "-": () => this.zoomBy(1 / 1.15),
      0: () => this.reset(),
    };
    canvas.addEventListener("keydown", (event) => {
      const action = keys[event.key];
      if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      action();
    });
  }
}
