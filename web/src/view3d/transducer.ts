/** The probe: a moulded body in its own frame (x right, y deep, z out), with a notch on the marked side. */

import * as THREE from "three";
import type { ProbeInfo } from "../protocol";

const BODY = 0xb9c0c8;
const NOTCH = 0x5cc8ff;
const CABLE = 0x59616b;

export function transducer(probe: ProbeInfo): THREE.Group {
  const group = new THREE.Group();
  const half = probe.kind === "phased" ? 12 : faceHalf(probe);
  const thick = probe.kind === "linear" ? 9 : 12;
  const body = new THREE.ExtrudeGeometry(outline(probe, half), {
    depth: thick, bevelEnabled: true, bevelThickness: 4, bevelSize: 2.5, bevelSegments: 3, curveSegments: 16,
  });
  body.translate(0, 0, -thick / 2);
  const material = new THREE.MeshLambertMaterial({ color: BODY });
  const notch = new THREE.Mesh(new THREE.BoxGeometry(3, 12, 4), new THREE.MeshBasicMaterial({ color: NOTCH }));
  notch.position.set(-0.86 * half, -24, thick / 2 + 3.2);
  const cable = new THREE.CatmullRomCurve3([
    new THREE.Vector3(0, -95, 0), new THREE.Vector3(1, -112, 0), new THREE.Vector3(5, -132, -4), new THREE.Vector3(12, -160, -14),
  ]);
  group.add(
    new THREE.Mesh(body, material),
    notch,
    new THREE.Mesh(new THREE.TubeGeometry(cable, 16, 3.4, 10), new THREE.MeshLambertMaterial({ color: CABLE })),
  );
  return group;
}

function faceHalf(probe: ProbeInfo): number {
  if (probe.kind === "linear") return probe.aperture_mm / 2;
  return probe.radius_mm * Math.sin((probe.field_of_view_deg * Math.PI) / 360);
}

/** From the face up to the neck, seen from the front. */
function outline(probe: ProbeInfo, half: number): THREE.Shape {
  const angle = (probe.field_of_view_deg * Math.PI) / 360;
  const edge = probe.kind === "curvilinear" ? -probe.radius_mm * (1 - Math.cos(angle)) : 0;
  const neck = Math.min(half * 0.62, 16);
  const shape = new THREE.Shape();
  shape.moveTo(-half, edge - 3);
  if (probe.kind === "curvilinear") {
    for (let k = 0; k <= 16; k += 1) {
      const a = angle * (k / 8 - 1);
      shape.lineTo(probe.radius_mm * Math.sin(a), probe.radius_mm * (Math.cos(a) - 1) - 3);
    }
  } else shape.lineTo(half, edge - 3);
  shape.bezierCurveTo(half + 1, edge - 22, neck + 6, -34, neck, -48);
  shape.lineTo(neck * 0.9, -88);
  shape.quadraticCurveTo(neck * 0.88, -96, neck * 0.45, -96);
  shape.lineTo(-neck * 0.45, -96);
  shape.quadraticCurveTo(-neck * 0.88, -96, -neck * 0.9, -88);
  shape.lineTo(-neck, -48);
  shape.bezierCurveTo(-neck - 6, -34, -half - 1, edge - 22, -half, edge - 3);
  return shape;
}
