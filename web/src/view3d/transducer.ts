/** The probe: a moulded body in its own frame (x right, y deep, z out), a notch on the marked side, a ring to turn it by. */

import * as THREE from "three";
import type { ProbeOutline } from "../protocol";

const BODY = 0xc3cad2;
const LENS = 0x4a525b;
const NOTCH = 0x5cc8ff;
const CABLE = 0x59616b;
const RING = 0x8a949f;
const RING_HELD = 0x5cc8ff;

/** mm over the face: where the rubber lens ends, and the height of the body. */
const LENS_TOP = 4;
const TOP = 96;
const RING_HEIGHT = 54;
/** mm around the ring where a pointer still grips it. */
const GRIP = 5;
/** Roundness of the cross-section: 2 is an ellipse. */
const ROUND = 2.7;
const AROUND = 48;

export const RING_NAME = "ring";

export function transducer(probe: ProbeOutline): THREE.Group {
  const shape = shapeOf(probe);
  const group = new THREE.Group();
  const cable = new THREE.CatmullRomCurve3([
    new THREE.Vector3(0, -94, 0), new THREE.Vector3(1, -112, 0), new THREE.Vector3(5, -132, -4), new THREE.Vector3(12, -160, -14),
  ]);
  const [wide, thick] = shape.size(26);
  const notch = new THREE.Mesh(new THREE.CapsuleGeometry(1.7, 9, 4, 10), new THREE.MeshBasicMaterial({ color: NOTCH }));
  notch.position.set(-0.78 * wide, -26 + 0.5 * shape.face(0.78 * wide), -thick * (1 - 0.78 ** ROUND) ** (1 / ROUND));
  group.add(
    new THREE.Mesh(skin(shape, heights(LENS_TOP, TOP)), new THREE.MeshPhongMaterial({ color: BODY, specular: 0x30353b, shininess: 24 })),
    new THREE.Mesh(skin(shape, heights(0.6, LENS_TOP)), new THREE.MeshPhongMaterial({ color: LENS, specular: 0x101214, shininess: 12 })),
    notch,
    new THREE.Mesh(new THREE.TubeGeometry(cable, 16, 3.4, 12), new THREE.MeshLambertMaterial({ color: CABLE })),
    ring(shape.size(RING_HEIGHT)[0] + 11),
  );
  return group;
}

/** Light the ring under the pointer, or let it go dark; whether that changed anything. */
export function lightRing(probe: THREE.Group, on: boolean): boolean {
  const seen = probe.getObjectByName(RING_NAME)?.children[0] as THREE.Mesh<THREE.BufferGeometry, THREE.MeshBasicMaterial> | undefined;
  const colour = on ? RING_HELD : RING;
  if (!seen || seen.material.color.getHex() === colour) return false;
  seen.material.color.set(colour);
  return true;
}

/** What is seen is thin; what is gripped is not. */
function ring(radius: number): THREE.Group {
  const group = new THREE.Group();
  const seen = new THREE.Mesh(new THREE.TorusGeometry(radius, 0.8, 8, 64), new THREE.MeshBasicMaterial({ color: RING }));
  const grip = new THREE.Mesh(new THREE.TorusGeometry(radius, GRIP, 6, 32), new THREE.MeshBasicMaterial({ colorWrite: false, depthWrite: false }));
  group.add(seen, grip);
  group.name = RING_NAME;
  group.rotation.x = Math.PI / 2;
  group.position.y = -RING_HEIGHT;
  return group;
}

interface Shape {
  /** y of the face's edge beside the middle, 0 in the middle and less beside it. */
  face(x: number): number;
  /** Half width and half thickness so many mm over the face. */
  size(height: number): readonly [number, number];
}

function shapeOf({ width_mm, thickness_mm, face_radius_mm: radius }: ProbeOutline): Shape {
  const half = width_mm / 2;
  const thick = thickness_mm / 2;
  const neck = Math.min(half * 0.6, 16);
  return {
    face: (x) => (radius > 0 ? Math.sqrt(Math.max(0, radius ** 2 - x ** 2)) - radius : 0),
    size: (height) => {
      const waist = smooth((height - 10) / 42);
      const end = Math.sqrt(Math.max(0, 1 - Math.max(0, (height - (TOP - 9)) / 9) ** 2));
      const wide = half + (neck - half) * waist - 0.04 * Math.max(0, height - 52);
      return [wide * (0.45 + 0.55 * end), (thick + (12.5 - thick) * waist) * (0.45 + 0.55 * end)];
    },
  };
}

const smooth = (t: number): number => (t <= 0 ? 0 : t >= 1 ? 1 : t * t * (3 - 2 * t));

function heights(from: number, to: number): number[] {
  const count = Math.ceil((to - from) / 3) + 1;
  return Array.from({ length: count }, (_, k) => from + ((to - from) * k) / (count - 1));
}

/** Cross-sections one above the other; both ends are closed from front to back. */
function skin(shape: Shape, levels: readonly number[]): THREE.BufferGeometry {
  const vertices: number[] = [];
  const indices: number[] = [];
  for (const height of levels) {
    const [wide, thick] = shape.size(height);
    // the curve of the face fades out on the way up
    const curve = Math.max(0, 1 - height / 40);
    for (let k = 0; k < AROUND; k += 1) {
      const angle = (2 * Math.PI * k) / AROUND;
      const [x, z] = [wide * rounded(Math.cos(angle)), thick * rounded(Math.sin(angle))];
      vertices.push(x, curve * shape.face(x) - height, z);
    }
  }
  for (let level = 0; level + 1 < levels.length; level += 1) {
    for (let k = 0; k < AROUND; k += 1) {
      const [a, b] = [level * AROUND + k, level * AROUND + ((k + 1) % AROUND)];
      indices.push(a, b, a + AROUND, b, b + AROUND, a + AROUND);
    }
  }
  for (const [start, up] of [[0, false], [(levels.length - 1) * AROUND, true]] as const) {
    for (let k = 0; k < AROUND / 2; k += 1) {
      const [a, b] = [start + k, start + k + 1];
      const [c, d] = [start + ((AROUND - k) % AROUND), start + AROUND - k - 1];
      indices.push(...(up ? [a, b, c, b, d, c] : [a, c, b, b, c, d]));
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(vertices, 3));
  geometry.setIndex(indices);
  geometry.computeVertexNormals();
  return geometry;
}

function rounded(c: number): number {
  return Math.sign(c) * Math.abs(c) ** (2 / ROUND);
}
