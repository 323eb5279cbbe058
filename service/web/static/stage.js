// Several shapes drawn side by side, turned together: one camera, one WebGL context, a canvas a shape.

import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, Group, InstancedMesh, Matrix4,
  Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Scene, SphereGeometry, Vector3, WebGLRenderer,
} from "./vendor/three.js";

/** @import { Model } from "./glb.js" */
/** @import { Colour } from "./paint.js" */

// As service/rendering/viewpoint.py has them.
const ELEVATION = 18, AZIMUTH = 28;
const RADIANS = Math.PI / 180;
const FIELD = 30;
const DOT = 0.028;
const REACH = 14;

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
    this.group = new Group();
    this.group.matrixAutoUpdate = false;
    this.group.matrix.fromArray(model.matrix);
    this.light = new DirectionalLight(0xffffff, 2.2);
    this.scene.add(this.group, this.light, new AmbientLight(0xffffff, 1.1));
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute("position", new BufferAttribute(model.positions, 3));
    this.geometry.setIndex(new BufferAttribute(model.indices, 1));
    this.geometry.computeVertexNormals();
    this.geometry.computeBoundingSphere();
    this.radius = this.geometry.boundingSphere?.radius || 1;
    this.middle = (this.geometry.boundingSphere?.center ?? new Vector3()).applyMatrix4(this.group.matrix);
    this.surface = new MeshLambertMaterial({ vertexColors: true, side: DoubleSide });
    this.group.add(new Mesh(this.geometry, this.surface));
    /** @type {Vector3[]} */
    this.points = [];
    /** @type {InstancedMesh | null} */
    this.dots = null;
    this.marks = new Group();
    this.group.add(this.marks);
    /** @type {number[]} */
    this.marked = [];
  }

  /**
   * @param {Float32Array | Colour} colours One a vertex, or one for all.
   */
  paint(colours) {
    const each = colours instanceof Float32Array ? colours : new Float32Array(this.model.positions.length);
    if (!(colours instanceof Float32Array)) for (let i = 0; i < each.length; i++) each[i] = colours[i % 3];
    const linear = new Color();
    const stored = new Float32Array(each.length);
    for (let i = 0; i < each.length; i += 3) linear.setRGB(each[i], each[i + 1], each[i + 2], "srgb").toArray(stored, i);
    this.geometry.setAttribute("color", new BufferAttribute(stored, 3));
    this.stage.changed();
  }

  /**
   * @param {number[][]} points As the model has them.
   * @param {Colour[]} colours
   * @param {boolean[]} large Whether each is drawn in full size.
   */
  setPoints(points, colours, large) {
    this.points = points.map(([x, y, z]) => new Vector3(x, y, z));
    const dots = new InstancedMesh(new SphereGeometry(1, 10, 8), new MeshBasicMaterial(), points.length);
    const colour = new Color();
    for (const [i, point] of this.points.entries()) {
      const size = DOT * this.radius * (large[i] ? 1 : 0.55);
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
    this.marks.clear();
    for (const number of numbers) {
      const size = 2.6 * DOT * this.radius;
      for (const [scale, colour] of [[1, 0x000000], [0.8, 0xffd400]]) {
        // Seen through the surface, the yellow one in front.
        const material = new MeshBasicMaterial({ color: colour, depthTest: false, transparent: true });
        const ball = new Mesh(new SphereGeometry(size * scale, 14, 10), material);
        ball.renderOrder = scale < 1 ? 2 : 1;
        ball.position.copy(this.points[number]);
        this.marks.add(ball);
      }
    }
    this.stage.changed();
  }

  /**
   * The point that is seen at a place on the canvas; -1 where there is none near.
   * @param {number} x
   * @param {number} y In CSS pixels from the corner.
   */
  pointAt(x, y) {
    const { width, height } = this.canvas.getBoundingClientRect();
    this.stage.aim(this);
    let best = -1, nearest = Infinity;
    const at = new Vector3();
    for (const [i, point] of this.points.entries()) {
      at.copy(point).applyMatrix4(this.group.matrix).project(this.stage.camera);
      const distance = Math.hypot(((at.x + 1) / 2) * width - x, ((1 - at.y) / 2) * height - y);
      // Of those that are about as near, the one in front.
      const worth = distance / REACH + 40 * at.z;
      if (distance <= REACH && worth < nearest) [best, nearest] = [i, worth];
    }
    return best;
  }
}

/** All views, and how they are looked at. */
export class Stage {
  constructor() {
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true });
    this.camera = new PerspectiveCamera(FIELD, 1, 0.01, 100);
    /** @type {View[]} */
    this.views = [];
    this.turning = false;
    this.waiting = false;
    this.azimuth = AZIMUTH * RADIANS;
    this.elevation = ELEVATION * RADIANS;
    this.zoom = 1;
    this.sizes = new ResizeObserver(() => this.changed());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.changed());
  }

  /** The first view again. */
  reset() {
    this.azimuth = AZIMUTH * RADIANS;
    this.elevation = ELEVATION * RADIANS;
    this.zoom = 1;
    this.changed();
  }

  /** Drop all views. */
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
    this.sizes.observe(canvas);
    this.listen(view);
    return view;
  }

  /** @param {number} across @param {number} up In radians. */
  turn(across, up) {
    this.azimuth += across;
    this.elevation = Math.max(-1.5, Math.min(1.5, this.elevation + up));
    this.changed();
  }

  /** @param {number} factor */
  approach(factor) {
    this.zoom = Math.max(0.3, Math.min(8, this.zoom * factor));
    this.changed();
  }

  /** @param {boolean} turning */
  keepTurning(turning) {
    this.turning = turning;
    this.changed();
  }

  /** Draw soon, once. */
  changed() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
      if (this.turning && this.views.length > 0) this.turn(0.006, 0);
    });
  }

  /** Look at a view's shape. @param {View} view */
  aim(view) {
    const { camera } = this;
    const distance = (1.05 * view.radius) / Math.sin((FIELD / 2) * RADIANS) / this.zoom;
    const level = Math.cos(this.elevation);
    camera.position
      .set(level * Math.sin(this.azimuth), Math.sin(this.elevation), level * Math.cos(this.azimuth))
      .multiplyScalar(distance)
      .add(view.middle);
    camera.near = distance / 50;
    camera.far = distance + 4 * view.radius;
    camera.aspect = view.canvas.clientWidth / Math.max(1, view.canvas.clientHeight);
    camera.lookAt(view.middle);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    // From the upper left of the eye.
    view.light.position.set(-0.5, 0.9, 1).applyQuaternion(camera.quaternion);
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
      this.renderer.render(view.scene, this.camera);
      const flat = canvas.getContext("2d");
      flat?.clearRect(0, 0, width, height);
      flat?.drawImage(this.renderer.domElement, 0, 0);
      canvas.dataset.drawn = "yes";
    }
  }

  /** Turn and zoom by pointer and keys. @param {View} view */
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
      this.turn((from.x - event.clientX) * 0.01, (event.clientY - from.y) * 0.01);
      held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    });
    canvas.addEventListener("wheel", (event) => {
      // Without the key the page scrolls.
      if (!event.ctrlKey) return;
      event.preventDefault();
      this.approach(Math.exp(-event.deltaY * 0.004));
    }, { passive: false });
    /** @type {Record<string, () => void>} */
    const keys = {
      ArrowLeft: () => this.turn(-0.12, 0),
      ArrowRight: () => this.turn(0.12, 0),
      ArrowUp: () => this.turn(0, 0.12),
      ArrowDown: () => this.turn(0, -0.12),
      "+": () => this.approach(1.15),
      "-": () => this.approach(1 / 1.15),
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
