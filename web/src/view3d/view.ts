/** The 3-D view: drawn only when something changed, and never so often that the image would wait for it. */

import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { sector } from "../image/sector";
import type { Frame, Geometry, Scene, SkinDirections } from "../protocol";
import { add, scale, toWorld, turnToWorld, type Vec } from "../vec";
import { FOV, framed, inSight, needleIn } from "./framing";
import { ImagePlane } from "./imagePlane";
import { boxEdges, dispose, NeedleModel, TargetModel } from "./instruments";
import { Screen } from "./screen";
import { TissueModel } from "./tissue";
import { transducer } from "./transducer";

/** How far the camera stands to the side and above, for one forwards. */
const SIDE = 0.42;
const ABOVE = 0.4;
/** The view takes at most this share of the time, and no more than so many ms from one picture to the next. */
const SHARE = 0.3;
const FASTEST = 30;
const SLOWEST = 250;
/** ms without change until a view is at rest. */
const STILL = 600;
/** Drawn by a processor, which the image needs too. */
const FASTEST_SOFTWARE = 160;
const COARSE = 0.75;
const BACKGROUND = 0x06090c;

export class View3d {
  readonly canvas: HTMLCanvasElement;
  readonly camera = new THREE.PerspectiveCamera(FOV, 1, 5, 4000);
  readonly tissue = new TissueModel();
  readonly orbit: OrbitControls;
  probe: THREE.Group | null = null;
  private readonly screen = new Screen(BACKGROUND);
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
  private drawnAt = 0;
  private sharp = false;
  private shown = "";
  follow = false;

  constructor() {
    this.canvas = this.screen.canvas;
    this.canvas.className = "view3d";
    this.canvas.setAttribute("aria-hidden", "true"); // what it lies in has the name
    this.orbit = new OrbitControls(this.camera, this.canvas);
    this.orbit.enableDamping = false;
    this.orbit.keys = { LEFT: "", UP: "", RIGHT: "", BOTTOM: "" };
    this.orbit.addEventListener("change", () => this.redraw());
    this.stage.add(this.plane.object, this.tissue.group, this.target.sprite, ...lights());
    this.plane.object.visible = false;
  }

  get software(): boolean {
    return this.screen.software;
  }

  begin(scene: Scene): void {
    this.scene = scene;
    this.frame = null;
    this.shown = "";
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
    this.tissue.clear();
    shine(this.stage, scene.frame);
    this.home();
  }

  build(geometry: Geometry): void {
    this.tissue.build(geometry);
    this.redraw();
  }

  take(frame: Frame): void {
    this.frame = frame;
    const { header, positions } = frame;
    if (!this.scene || !this.probe || !this.needle) return;
    // speckle that flickers with the electronic noise is not worth a picture
    const shown = JSON.stringify([header.image_to_reference, header.probe_to_reference, header.needle, header.target, header.state.image]);
    if (shown === this.shown && !positions) return;
    this.shown = shown;
    this.plane.show(frame, this.scene.probe);
    this.probe.matrix.set(...(header.probe_to_reference as unknown as Parameters<THREE.Matrix4["set"]>));
    this.probe.matrixWorldNeedsUpdate = true;
    this.plane.object.visible = this.probe.visible = this.needle.group.visible = true;
    this.needle.place(header);
    this.target.place(header);
    if (positions) this.tissue.move(positions, header.grid);
    if (this.follow) this.lookAlongProbe();
    this.redraw();
  }

  /** From the viewer's side, a little from the right and from above: everything in sight. */
  home(): void {
    const { scene } = this;
    if (!scene) return;
    const { right, depth, out } = scene.frame;
    const up = scale(depth, -1);
    const side = needleIn(scene) ? -SIDE : SIDE;
    const away = add(add(scale(out, -1), scale(right, side)), scale(up, ABOVE));
    const { centre, distance } = framed(inSight(scene), away, up, this.camera.aspect);
    this.look(centre, add(centre, scale(away, distance / Math.hypot(...away))), up);
  }

  /** The camera where the image's viewer is: the image is as it is on the screen. */
  lookAlongProbe(): void {
    const { scene, frame } = this;
    if (!scene || !frame) return;
    const pose = frame.header.probe_to_reference;
    const { outline } = sector(scene.probe, frame.header.state.image.depth);
    const points = outline.map(([x, y]) => toWorld(pose, [x, y, 0]));
    const [away, up] = [turnToWorld(pose, [0, 0, -1]), turnToWorld(pose, [0, -1, 0])];
    const { centre, distance } = framed(points, away, up, this.camera.aspect);
    this.look(centre, add(centre, scale(away, distance)), up);
  }

  resize(width: number, height: number): void {
    const first = this.size.width < 1;
    const before = this.camera.aspect;
    this.size = { width, height };
    this.sharpen(false);
    this.camera.aspect = Math.max(1, width) / Math.max(1, height);
    this.camera.updateProjectionMatrix();
    this.target.resize(height, FOV);
    if (this.follow) this.lookAlongProbe();
    else if (first || Math.abs(before - this.camera.aspect) > 0.2) this.home();
    this.redraw();
  }

  /** Where a place of the world is in the pane, px; null behind the camera. */
  onPane(place: Vec): readonly [number, number] | null {
    const at = new THREE.Vector3(...(place as [number, number, number])).project(this.camera);
    const { width, height } = this.size;
    return at.z > 1 ? null : [((at.x + 1) / 2) * width, ((1 - at.y) / 2) * height];
  }

  redraw(): void {
    this.dirty = true;
  }

  /** Once an animation frame, after the image. */
  tick(now: number): void {
    const { screen } = this;
    if (this.size.width < 1) return;
    screen.tick();
    if (screen.busy) return;
    const still = !this.dirty && screen.software && !this.sharp && now - this.drawnAt > STILL;
    if (still) this.sharpen(true);
    else if (!this.dirty || now < this.nextAt) return;
    else if (this.sharp) this.sharpen(false);
    const start = performance.now();
    screen.draw(this.stage, this.camera);
    const took = performance.now() - start;
    this.drawnAt = now;
    this.nextAt = now + Math.min(SLOWEST, Math.max(screen.software ? FASTEST_SOFTWARE : FASTEST, took / SHARE));
    this.dirty = false;
  }

  /** Drawn by a processor, a view in motion is coarse, and one at rest is drawn once more at twice the size. */
  private sharpen(on: boolean): void {
    const { width, height } = this.size;
    this.sharp = on;
    const plain = this.screen.software ? COARSE : Math.min(window.devicePixelRatio, 2);
    this.screen.resize(width, height, on ? 2 : plain);
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

function lights(): THREE.Light[] {
  const sun = new THREE.DirectionalLight(0xffffff, 2.4);
  const fill = new THREE.DirectionalLight(0xcfe4ff, 0.7);
  sun.name = "sun";
  fill.name = "fill";
  return [new THREE.HemisphereLight(0xffffff, 0x4a5058, 0.8), sun, fill];
}

/** Light from above the skin and from the viewer's side. */
function shine(stage: THREE.Scene, { right, depth, out }: SkinDirections): void {
  const up = scale(depth, -1);
  const place = (name: string, from: Vec) => stage.getObjectByName(name)?.position.set(from[0], from[1], from[2]);
  place("sun", add(add(scale(out, -0.8), scale(up, 1.3)), scale(right, 0.8)));
  place("fill", add(add(scale(out, -0.3), scale(up, 0.2)), scale(right, -1)));
}
