/** Where marks belong in image coordinates: needle, skin, path to the target. Pure; mm. */

import type { NeedleCommand, NeedlePlace, SkinDirections, TargetPlace } from "../protocol";
import { add, dot, needleDirection, norm, scale, sub, toFrame, turnToFrame, type Vec } from "../vec";
import type { Pane } from "./fit";
import type { Point } from "./sector";

export interface NeedleInImage {
  entry: Point;
  /** Unit direction in the plane, and the share of the needle that runs in it. */
  along: Point;
  share: number;
}

/** A needle as it is asked for, projected on the image. */
export function needleInImage(frame: SkinDirections, pose: NeedleCommand, imageToReference: Vec): NeedleInImage {
  const entry = add(add(frame.skin_origin, scale(frame.right, pose.u)), scale(frame.out, pose.v));
  const [x, y] = toFrame(imageToReference, entry);
  const [dx, dy] = turnToFrame(imageToReference, needleDirection(frame, pose.angle, pose.swing));
  const share = Math.hypot(dx, dy);
  return { entry: [x, y], along: share > 0 ? [dx / share, dy / share] : [0, 1], share };
}

/** The skin in the image: a point of the line and its direction towards the right. */
export function skinLine(frame: SkinDirections, imageToReference: Vec): { through: Point; along: Point } | null {
  const normal = turnToFrame(imageToReference, frame.depth);
  const [a, b] = normal;
  const size = Math.hypot(a, b);
  if (size < 1e-3) return null;
  const origin = toFrame(imageToReference, frame.skin_origin);
  // points p of the plane z = 0 with n . (p - origin) = 0
  const offset = dot(normal, origin) / (size * size);
  return { through: [a * offset, b * offset], along: [b / size, -a / size] };
}

/** From the tip along the needle to the point nearest the target, with a tick each `tick` mm; empty beyond it. */
export function pathAhead(needle: NeedlePlace, target: TargetPlace, tick: number): { end: Vec; ticks: Vec[]; length: number } | null {
  const { tip, direction } = needle;
  const length = dot(sub(target.now, tip), direction) / norm(direction);
  if (length <= 0) return null;
  const place = (t: number) => add(tip, scale(direction, t));
  const ticks = Array.from({ length: Math.floor(length / tick) }, (_, k) => place((k + 1) * tick));
  return { end: place(length), ticks, length };
}

/** Whether a point of the image plane lies in a polygon. */
export function inside(polygon: readonly Point[], [x, y]: Point): boolean {
  let odd = false;
  for (let i = 0, j = polygon.length - 1; i < polygon.length; j = i, i += 1) {
    const [xi, yi] = polygon[i];
    const [xj, yj] = polygon[j];
    if (yi > y !== yj > y && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) odd = !odd;
  }
  return odd;
}

/** How far along a ray a point must go to be in the pane, `inset` from its edges; 0 where it is, or never comes. */
export function intoSight(from: Point, along: Point, pane: Pane, inset: number): number {
  const [width, height] = [pane.width - inset, pane.height - inset];
  const toGo = (x: number, v: number, low: number, high: number) => (x < low ? (low - x) / v : x > high ? (high - x) / v : 0);
  const far = Math.max(toGo(from[0], along[0], inset, width), toGo(from[1], along[1], inset, height));
  return Number.isFinite(far) && far > 0 ? far : 0;
}

/** How far along a ray the polygon begins, at most `far`. */
export function reach(polygon: readonly Point[], from: Point, along: Point, far: number, step = 0.5): number {
  for (let t = 0; t < far; t += step) {
    if (inside(polygon, [from[0] + t * along[0], from[1] + t * along[1]])) return t;
  }
  return far;
}
