/** The 3-D view: drawn only when something changed, and never so often that the image would wait for it. */

import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { sector } from "../image/sector";
import type { Frame, Geometry, Scene } from "../protocol";
import { add, scale, toWorld, turnToFrame, type Vec } from "../vec";
import { ImagePlane } from "./imagePlane";
import { boxEdges, dispose, NeedleModel, TargetModel } from "./instruments";
import { TissueModel } from "./tissue";
import { transducer } from "./transducer";

const FOV = 30;
/** The view takes at most this share of the time, and no more than so many ms from one picture to the next. */
const SHARE = 0.3;
const FASTEST = 30;
const SLOWEST = 250;
/** Drawn by a processor, which the image needs too. */
const FASTEST_SOFTWARE = 80;

export class View3d {
  readonly canvas: HTMLCanvasElement;
  readonly camera = new THREE.PerspectiveCamera(FOV, 1, 5, 4000);
  readonly tissue = new TissueModel();
  readonly orbit: OrbitControls;
  probe: THREE.Group | null = null;
  private readonly renderer: THREE.WebGLRenderer;
  private readonly software: boolean;
  private readonly stage = new THREE.Scene();
  private readonly plane = new ImagePlane();
  private readonly target = new TargetModel();
  private needle: NeedleModel | null = null;
  private box: THREE.LineSegments | null = null;
  private scene: Scene | null = null;
  private frame: Frame | null = null;
  private size = { width: 0, height: 0 };
  private dirty = true;
  private nextAt = 0;
  follow = false;

  constructor() {
    this.software = isSoftware();
    this.renderer = new THREE.WebGLRenderer({ antialias: !this.software && window.devicePixelRatio < 2 });
    this.renderer.setClearColor(0x06090c);
    this.canvas = this.renderer.domElement;
    this.canvas.className = "view3d";
    this.orbit = new OrbitControls(this.camera, this.canvas);
    this.orbit.enableDamping = false;
    this.orbit.keys = { LEFT: "", UP: "", RIGHT: "", BOTTOM: "" };
    this.orbit.addEventListener("change", () => this.redraw());
    this.stage.add(this.plane.object, this.tissue.group, this.target.sprite, ...lights());
    this.plane.object.visible = false;
  }

  begin(scene: Scene): void {
    this.scene = scene;
    this.frame = null;
    this.plane.object.visible = false;
    for (const old of [this.probe, this.needle?.group, this.box]) {
      if (!old) continue;
      this.stage.remove(old);
      dispose(old);
    }
    this.probe = transducer(scene.probe);
    this.probe.matrixAutoUpdate = false;
    this.probe.visible = false;
    this.needle = new NeedleModel(scene.needle.length_mm);
    this.needle.group.visible = false;
    this.box = boxEdges(scene);
    this.stage.add(this.probe, this.needle.group, this.box);
    this.home();
  }

  build(geometry: Geometry): void {
    if (this.scene) this.tissue.build(geometry, this.scene.meshes);
    this.redraw();
  }

  take(frame: Frame): void {
    this.frame = frame;
    const { header, positions } = frame;
    if (!this.scene || !this.probe || !this.needle) return;
    this.plane.show(frame, this.scene.probe);
    this.probe.matrix.set(...(header.probe_to_reference as unknown as Parameters<THREE.Matrix4["set"]>));
    this.probe.matrixWorldNeedsUpdate = true;
    this.plane.object.visible = this.probe.visible = this.needle.group.visible = true;
    this.needle.place(header);
    this.target.place(header);
    if (positions) this.tissue.move(positions, header.grid === true);
    if (this.follow) this.lookAlongProbe();
    this.redraw();
  }

  /** Two thirds from the front, a little from above: everything in sight. */
  home(): void {
    const { scene } = this;
    if (!scene) return;
    const { right, depth, out } = scene.frame;
    const middle = scale(add(scene.box.low, scene.box.high), 0.5);
    const size = Math.hypot(...scene.box.high.map((x, k) => x - scene.box.low[k]));
    // the probe stands above the box
    const centre = add(middle, scale(depth, -0.12 * size));
    const away = add(add(scale(out, 1), scale(right, 0.42)), scale(depth, -0.4));
    this.look(centre, add(centre, scale(away, (1.42 * size) / Math.hypot(...away) * this.widen())), scale(depth, -1));
  }

  /** The camera where the image's viewer is. */
  lookAlongProbe(): void {
    const { scene, frame } = this;
    if (!scene || !frame) return;
    const pose = frame.header.probe_to_reference;
    const depth = frame.header.state.image.depth;
    const { low, high } = sector(scene.probe, depth);
    const middle = [0, 0.42 * (low[1] + high[1]), 0];
    const far = (1.35 * Math.max(high[0] - low[0], high[1] - low[1] + 40)) / (2 * Math.tan((FOV * Math.PI) / 360));
    const up = turnToFrame(transposed(pose), [0, -1, 0]);
    this.look(toWorld(pose, middle), toWorld(pose, [middle[0], middle[1], far * this.widen()]), up);
  }

  resize(width: number, height: number): void {
    const before = this.widen();
    this.size = { width, height };
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / Math.max(1, height);
    this.camera.updateProjectionMatrix();
    this.target.resize(height, FOV);
    if (this.follow) this.lookAlongProbe();
    else if (Math.abs(before - this.widen()) > 0.01) {
      const offset = this.camera.position.clone().sub(this.orbit.target).multiplyScalar(this.widen() / before);
      this.camera.position.copy(this.orbit.target).add(offset);
      this.orbit.update();
    }
    this.redraw();
  }

  redraw(): void {
    this.dirty = true;
  }

  /** Once an animation frame, after the image. */
  tick(now: number): void {
    if (!this.dirty || now < this.nextAt || this.size.width < 1) return;
    const start = performance.now();
    this.renderer.render(this.stage, this.camera);
    const took = performance.now() - start;
    this.nextAt = now + Math.min(SLOWEST, Math.max(this.software ? FASTEST_SOFTWARE : FASTEST, took / SHARE));
    this.dirty = false;
  }

  /** A pane narrower than high needs more distance. */
  private widen(): number {
    return Math.max(1, (0.95 * this.size.height) / Math.max(1, this.size.width));
  }

  private look(at: Vec, from: Vec, up: Vec): void {
    this.camera.up.set(up[0], up[1], up[2]);
    this.camera.position.set(from[0], from[1], from[2]);
    this.orbit.target.set(at[0], at[1], at[2]);
    // the controls keep the `up` they were made with
    const controls = this.orbit as unknown as { _quat: THREE.Quaternion; _quatInverse: THREE.Quaternion };
    controls._quat.setFromUnitVectors(this.camera.up, new THREE.Vector3(0, 1, 0));
    controls._quatInverse.copy(controls._quat).invert();
    this.orbit.update();
    this.redraw();
  }
}

/** Whether WebGL runs on the processor; throws where there is none. */
function isSoftware(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  if (!context) throw new Error("this browser has no WebGL 2");
  const info = context.getExtension("WEBGL_debug_renderer_info");
  const name = String(context.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : context.RENDERER));
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

function lights(): THREE.Light[] {
  const sun = new THREE.DirectionalLight(0xffffff, 1.7);
  const fill = new THREE.DirectionalLight(0xcfe4ff, 0.7);
  sun.position.set(0.4, 0.8, 1);
  fill.position.set(-0.7, -0.6, -0.3);
  return [new THREE.HemisphereLight(0xffffff, 0x4a4f58, 1.3), sun, fill];
}

function transposed(m: Vec): number[] {
  return [m[0], m[4], m[8], 0, m[1], m[5], m[9], 0, m[2], m[6], m[10], 0, 0, 0, 0, 1];
}
