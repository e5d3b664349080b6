/** Where the image lies in its pane, and from image mm to pane pixels and back. */

import { clamp } from "../vec";
import type { Point } from "./sector";

export interface Margins { left: number; top: number; right: number; bottom: number }
export interface Box { left: number; top: number; width: number; height: number }
export interface Pane { width: number; height: number }

/** Columns and rows of pixels with their size in mm; the origin of the image frame is the centre of pixel (0, 0). */
export interface Raster { columns: number; rows: number; pixel: readonly [number, number] }

/** px at the sides that the image leaves free where it can: the texts in the black corners. */
export interface Keep { left: number; right: number }

/** The largest box of the image's aspect within the margins; in the middle, but beside what is kept free if it can be. */
export function fit(pane: Pane, raster: Raster, margins: Margins, keep: Keep = { left: 0, right: 0 }): Box {
  const wide = raster.columns * raster.pixel[0];
  const high = raster.rows * raster.pixel[1];
  const room = {
    width: Math.max(1, pane.width - margins.left - margins.right),
    height: Math.max(1, pane.height - margins.top - margins.bottom),
  };
  const scale = Math.min(room.width / wide, room.height / high);
  const [width, height] = [wide * scale, high * scale];
  const middle = (pane.width - width) / 2;
  const [first, last] = [margins.left, Math.max(margins.left, pane.width - margins.right - width)];
  const left = clamp(Math.max(keep.left, Math.min(middle, pane.width - keep.right - width)), first, last);
  return { left, top: margins.top, width, height };
}

/** Image mm to pane pixels; mirrored, the image's left is on the right. */
export class Mapping {
  readonly scale: number;
  /** 1, or -1 where it is mirrored: the image's x goes to the left. */
  readonly sign: 1 | -1;

  constructor(
    readonly box: Box,
    readonly raster: Raster,
    readonly pane: Pane,
    mirrored = false,
  ) {
    this.scale = box.width / (raster.columns * raster.pixel[0]);
    this.sign = mirrored ? -1 : 1;
  }

  point(p: readonly number[]): Point {
    const { box, raster, scale } = this;
    const x = (p[0] + raster.pixel[0] / 2) * scale;
    return [this.sign > 0 ? box.left + x : box.left + box.width - x, box.top + (p[1] + raster.pixel[1] / 2) * scale];
  }

  /** Pane pixels to image mm. */
  back(p: Point): Point {
    const { box, raster, scale } = this;
    const x = this.sign > 0 ? p[0] - box.left : box.left + box.width - p[0];
    return [x / scale - raster.pixel[0] / 2, (p[1] - box.top) / scale - raster.pixel[1] / 2];
  }

  /** A direction in the image as it is on the screen. */
  turned([x, y]: readonly [number, number]): Point {
    return [this.sign * x, y];
  }
}
