/** The outline of what a probe sees, in the probe's frame: x right, y deep, origin in the middle of its face; mm. */

import type { ProbeInfo } from "../protocol";

export type Point = readonly [number, number];

export interface Sector {
  /** The transducer's face, left to right. */
  face: Point[];
  /** The deep end, left to right. */
  deep: Point[];
  /** Face, right edge, deep end, left edge. */
  outline: Point[];
  low: Point;
  high: Point;
}

const ARC = 48;

export function sector(probe: ProbeInfo, depth: number): Sector {
  const [face, deep] = probe.kind === "linear" ? straight(probe.aperture_mm, depth) : curved(probe, depth);
  const outline = [...face, ...[...deep].reverse()];
  const xs = outline.map(([x]) => x);
  const ys = outline.map(([, y]) => y);
  return {
    face,
    deep,
    outline,
    low: [Math.min(...xs), Math.min(...ys)],
    high: [Math.max(...xs), Math.max(...ys)],
  };
}

function straight(width: number, depth: number): [Point[], Point[]] {
  const across = (y: number): Point[] => [[-width / 2, y], [width / 2, y]];
  return [across(0), across(depth)];
}

function curved(probe: ProbeInfo, depth: number): [Point[], Point[]] {
  const half = (probe.field_of_view_deg * Math.PI) / 360;
  const radius = probe.kind === "curvilinear" ? probe.radius_mm : 0;
  const arc = (r: number): Point[] =>
    Array.from({ length: ARC + 1 }, (_, i) => {
      const angle = half * ((2 * i) / ARC - 1);
      return [r * Math.sin(angle), r * Math.cos(angle) - radius];
    });
  return [radius > 0 ? arc(radius) : [[0, 0]], arc(radius + depth)];
}
