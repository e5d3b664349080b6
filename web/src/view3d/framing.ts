/** Where a camera has to stand so that points are in sight. Pure. */

import type { Scene } from "../protocol";
import { add, cross, dot, needleDirection, norm, scale, type Vec } from "../vec";

/** Vertical opening of the camera, degrees. */
export const FOV = 30;
const AIR = 1.06;
/** mm of the probe above the skin. */
const PROBE_HEIGHT = 108;
/** mm of the needle's hub behind its length, and of its rim beside its axis. */
const HUB = 7;
const RIM = 6;

/** The middle of what is seen and the distance from it; `away` points from there to the camera. */
export function framed(points: readonly Vec[], away: Vec, up: Vec, aspect: number): { centre: number[]; distance: number } {
  const z = scale(away, 1 / norm(away));
  const across = cross(up, z);
  const x = scale(across, 1 / norm(across));
  const y = cross(z, x);
  const seen = points.map((p) => [dot(p, x), dot(p, y), dot(p, z)]);
  const middle = [0, 1, 2].map((k) => {
    const values = seen.map((p) => p[k]);
    return (Math.min(...values) + Math.max(...values)) / 2;
  });
  const slope = Math.tan((FOV * Math.PI) / 360) / AIR;
  const distances = seen.map(([px, py, pz]) => pz - middle[2] + Math.max(Math.abs(py - middle[1]) / slope, Math.abs(px - middle[0]) / (slope * aspect)));
  const centre = add(add(scale(x, middle[0]), scale(y, middle[1])), scale(z, middle[2]));
  return { centre, distance: Math.max(...distances) };
}

/** The corners of the tissue, the probe, and all of the needle while it is out. */
export function inSight(scene: Scene): number[][] {
  const { low, high } = scene.box;
  const { right, depth, out, skin_origin } = scene.frame;
  const corners = Array.from({ length: 8 }, (_, k) => [0, 1, 2].map((axis) => ((k >> axis) & 1 ? high : low)[axis]));
  const { u, v, angle, swing } = scene.start.needle;
  const entry = add(add(skin_origin, scale(right, u)), scale(out, v));
  const hub = add(entry, scale(needleDirection(scene.frame, angle, swing), -(scene.needle.length_mm + HUB)));
  const rim = [right, depth, out].flatMap((way) => [-RIM, RIM].map((far) => add(hub, scale(way, far))));
  return [...corners, add(skin_origin, scale(depth, -PROBE_HEIGHT)), ...rim];
}

/** Whether the needle comes in from the right. */
export function needleIn(scene: Scene): boolean {
  return scene.start.needle.u > 0;
}
