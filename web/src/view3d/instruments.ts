/** Needle and target: they come with the frame they belong to. */

import * as THREE from "three";
import type { FrameHeader, Scene } from "../protocol";

const ACCENT = 0x5cc8ff;
const TARGET = 0xffe04d;
/** px of the target's ring. */
const RING = 22;

/** Thicker than steel, or it could not be seen. */
const SHAFT_MM = 1.1;

export class NeedleModel {
  readonly group = new THREE.Group();

  constructor(length: number) {
    const shaft = new THREE.Mesh(
      new THREE.CylinderGeometry(SHAFT_MM, SHAFT_MM, length, 10).translate(0, -length / 2, 0),
      new THREE.MeshLambertMaterial({ color: 0xa8e2ff, emissive: 0x1d4b63 }),
    );
    const blue = new THREE.MeshLambertMaterial({ color: ACCENT });
    const hub = new THREE.Mesh(new THREE.CylinderGeometry(4.6, 2.4, 13, 20).translate(0, -length + 3, 0), blue);
    const rim = new THREE.Mesh(new THREE.CylinderGeometry(6, 6, 3, 20).translate(0, -length - 5, 0), blue);
    this.group.add(shaft, hub, rim);
  }

  /** The tip lies in the origin of the model, its shaft along -y. */
  place({ needle }: FrameHeader): void {
    if (!needle) return;
    this.group.position.set(needle.tip[0], needle.tip[1], needle.tip[2]);
    const along = new THREE.Vector3(...(needle.direction as [number, number, number]));
    this.group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.normalize());
  }

  dispose(): void {
    dispose(this.group);
  }
}

export class TargetModel {
  readonly sprite: THREE.Sprite;

  constructor() {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = 64;
    const context = canvas.getContext("2d") as CanvasRenderingContext2D;
    for (const [width, style] of [[11, "rgba(0,0,0,.65)"], [5.5, "#ffffff"]] as const) {
      context.lineWidth = width;
      context.strokeStyle = style;
      context.beginPath();
      context.arc(32, 32, 24, 0, 2 * Math.PI);
      context.stroke();
    }
    const map = new THREE.CanvasTexture(canvas);
    this.sprite = new THREE.Sprite(
      new THREE.SpriteMaterial({ map, color: TARGET, depthTest: false, sizeAttenuation: false, transparent: true }),
    );
    this.sprite.renderOrder = 1000;
  }

  place({ target }: FrameHeader): void {
    if (!target) return;
    this.sprite.position.set(target.now[0], target.now[1], target.now[2]);
  }

  /** The same number of px at any size of the pane. */
  resize(height: number, fov: number): void {
    const size = (2 * RING * Math.tan((fov * Math.PI) / 360)) / Math.max(1, height);
    this.sprite.scale.set(size, size, 1);
  }
}

/** The edges of the tissue's box. */
export function boxEdges(scene: Scene): THREE.LineSegments {
  const { low, high } = scene.box;
  const size = low.map((x, k) => high[k] - x) as [number, number, number];
  const solid = new THREE.BoxGeometry(...size);
  const edges = new THREE.EdgesGeometry(solid);
  solid.dispose();
  edges.translate(...(low.map((x, k) => x + size[k] / 2) as [number, number, number]));
  return new THREE.LineSegments(edges, new THREE.LineBasicMaterial({ color: 0x66717d, transparent: true, opacity: 0.6 }));
}

export function dispose(object: THREE.Object3D): void {
  object.traverse((child) => {
    if (child instanceof THREE.Mesh || child instanceof THREE.LineSegments) {
      (child.geometry as THREE.BufferGeometry).dispose();
      (child.material as THREE.Material).dispose();
    }
  });
}
