/** Three-vectors and rigid 4 x 4 transforms (row-major, mm), as the wire carries them. */

export type Vec = readonly number[];

export const add = (a: Vec, b: Vec): number[] => a.map((x, i) => x + b[i]);
export const sub = (a: Vec, b: Vec): number[] => a.map((x, i) => x - b[i]);
export const scale = (a: Vec, k: number): number[] => a.map((x) => k * x);
export const dot = (a: Vec, b: Vec): number => a.reduce((sum, x, i) => sum + x * b[i], 0);
export const norm = (a: Vec): number => Math.hypot(...a);
export const clamp = (x: number, low: number, high: number): number => Math.min(high, Math.max(low, x));

/** A point of the frame in the world. */
export function toWorld(m: Vec, p: Vec): number[] {
  return [0, 4, 8].map((row) => m[row] * p[0] + m[row + 1] * p[1] + m[row + 2] * p[2] + m[row + 3]);
}

/** A world point in the frame: the inverse of a rigid transform is its transpose. */
export function toFrame(m: Vec, p: Vec): number[] {
  const d = [p[0] - m[3], p[1] - m[7], p[2] - m[11]];
  return [0, 1, 2].map((column) => m[column] * d[0] + m[4 + column] * d[1] + m[8 + column] * d[2]);
}

/** A direction of the frame in the world. */
export function turnToWorld(m: Vec, v: Vec): number[] {
  return [0, 4, 8].map((row) => m[row] * v[0] + m[row + 1] * v[1] + m[row + 2] * v[2]);
}

export const cross = (a: Vec, b: Vec): number[] => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** A world direction in the frame. */
export function turnToFrame(m: Vec, v: Vec): number[] {
  return [0, 1, 2].map((column) => m[column] * v[0] + m[4 + column] * v[1] + m[8 + column] * v[2]);
}

/** The direction of a needle: in the plane from right towards depth, then out of it; degrees. */
export function needleDirection(frame: { right: Vec; depth: Vec; out: Vec }, angle: number, swing: number): number[] {
  const a = (angle * Math.PI) / 180;
  const s = (swing * Math.PI) / 180;
  const inPlane = add(scale(frame.right, Math.cos(a)), scale(frame.depth, Math.sin(a)));
  return add(scale(inPlane, Math.cos(s)), scale(frame.out, Math.sin(s)));
}
