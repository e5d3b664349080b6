import { describe, expect, it } from "vitest";
import { roomBeside } from "../src/image/corner";
import { fit, Mapping } from "../src/image/fit";
import { inside, intoSight, needleInImage, pathAhead, reach, skinLine } from "../src/image/geometry";
import { sector } from "../src/image/sector";
import { chooseLayout, keep, margins } from "../src/layouts";
import { standApart } from "../src/plotLabels";
import type { FrameHeader } from "../src/protocol";

const raster = { columns: 512, rows: 364, pixel: [0.35, 0.35] as const };
const probe = { name: "C5-2", kind: "curvilinear" as const, radius_mm: 60, aperture_mm: 62.8, field_of_view_deg: 60 };
const frame = { right: [1, 0, 0], depth: [0, 0, 1], out: [0, -1, 0], skin_origin: [10, 20, 0] };
/** x right, y deep, z = x cross y; the image's origin 50 mm left of the skin's. */
const IMAGE = [1, 0, 0, -40, 0, 0, -1, 20, 0, 1, 0, 0, 0, 0, 0, 1];

describe("fit", () => {
  it("keeps the aspect, grows as far as the height allows and leaves the read-outs free", () => {
    const pane = { width: 1080, height: 704 };
    const box = fit(pane, raster, margins("desktop", "curvilinear"), keep("desktop", false));
    expect(box.height).toBeCloseTo(644);
    expect(box.width / box.height).toBeCloseTo(512 / 364);
    expect(box.left).toBe(52);
  });

  it("goes to the other side where the needle comes from the right", () => {
    const box = fit({ width: 1080, height: 704 }, raster, margins("desktop", "curvilinear"), keep("desktop", true));
    expect(box.left + box.width).toBeCloseTo(1060);
  });

  it("leaves margins beside parallel beams", () => {
    const box = fit({ width: 1080, height: 704 }, { columns: 100, rows: 131, pixel: [0.38, 0.38] }, margins("desktop", "linear"));
    expect(box.left).toBeGreaterThan(189);
    expect(box.left + box.width).toBeLessThan(1080 - 189);
  });

  it("maps the centre of the first pixel and back", () => {
    const map = new Mapping({ left: 52, top: 32, width: 1024, height: 728 }, raster, { width: 1200, height: 800 });
    expect(map.point([0, 0])).toEqual([53, 33]);
    const [x, y] = map.back(map.point([12.5, 40]));
    expect(x).toBeCloseTo(12.5);
    expect(y).toBeCloseTo(40);
  });
});

describe("layouts", () => {
  it.each([[1440, 900, false, "desktop"], [1280, 820, false, "desktop"], [1279, 900, false, "compact"], [720, 450, false, "compact"], [1180, 820, true, "tablet"], [820, 1180, true, "tablet"], [744, 1133, true, "tablet"], [360, 740, true, "compact"], [740, 360, true, "compact"]] as const)(
    "%i x %i, coarse %s: %s",
    (width, height, coarse, layout) => expect(chooseLayout(width, height, coarse)).toBe(layout),
  );
});

describe("sector", () => {
  it("has the face's arc above and the deep arc below", () => {
    const { face, deep, low, high } = sector(probe, 120);
    expect(face[0][0]).toBeCloseTo(-30);
    expect(face[24]).toEqual([0, 0]);
    expect(deep[24][1]).toBeCloseTo(120);
    expect(high[0] - low[0]).toBeCloseTo(180);
  });
});

describe("needle and skin in the image", () => {
  it("puts the entry on the skin line and the direction in the plane", () => {
    const needle = needleInImage(frame, { u: -30, v: 0, angle: 60, swing: 0, depth: 40 }, IMAGE);
    expect(needle.entry).toEqual([20, 0]);
    expect(needle.along[0]).toBeCloseTo(0.5);
    expect(needle.share).toBeCloseTo(1);
    const skin = skinLine(frame, IMAGE);
    expect(skin?.through[1]).toBeCloseTo(0);
    expect(skin?.along).toEqual([1, -0]);
  });

  it("shortens what leaves the plane", () => {
    const needle = needleInImage(frame, { u: 0, v: 0, angle: 90, swing: 60, depth: 40 }, IMAGE);
    expect(needle.share).toBeCloseTo(0.5);
  });

  it("finds where the shaft enters the sector", () => {
    const square = [[0, 0], [10, 0], [10, 10], [0, 10]] as const;
    expect(inside(square, [5, 5])).toBe(true);
    expect(inside(square, [15, 5])).toBe(false);
    expect(reach(square, [-5, 5], [1, 0], 50)).toBeCloseTo(5);
    expect(reach(square, [-5, 5], [-1, 0], 50)).toBe(50);
  });

  it("brings a handle beside the pane into sight along the needle", () => {
    const far = intoSight([1100, 50], [-0.8, 0.6], { width: 1080, height: 700 }, 18);
    expect(1100 - 0.8 * far).toBeCloseTo(1062);
    expect(intoSight([500, 50], [-0.8, 0.6], { width: 1080, height: 700 }, 18)).toBe(0);
  });

  it("ends the path at the point nearest the target, with a tick each 5 mm", () => {
    const header = { needle: { entry: [0, 0, 0], tip: [0, 0, 10], direction: [0, 0, 1] }, target: { id: "t", now: [3, 0, 23], rest: [0, 0, 23] } };
    const path = pathAhead(header as unknown as FrameHeader, 5);
    expect(path?.end).toEqual([0, 0, 23]);
    expect(path?.ticks).toHaveLength(2);
    const beyond = { ...header, target: { ...header.target, now: [0, 0, 5] } };
    expect(pathAhead(beyond as unknown as FrameHeader, 5)).toBeNull();
  });
});

describe("the black corners", () => {
  const trapezium = [[40, 0], [60, 0], [100, 80], [0, 80]] as const;
  it("are as wide as the narrowest place beside the sector", () => {
    expect(roomBeside(trapezium, "right", 120, 0, 0)).toBe(60);
    expect(roomBeside(trapezium, "right", 120, 0, 40)).toBe(40);
    expect(roomBeside(trapezium, "left", 120, 20, 40)).toBe(20);
    expect(roomBeside(trapezium, "left", 120, 90, 100)).toBe(120);
  });
});

describe("the names of curves", () => {
  it("stand apart, near where they want to be, within the plot", () => {
    expect(standApart([50, 52, 90], 9, 100, 13)).toEqual([50, 63, 90]);
    expect(standApart([2, 3, 4], 9, 100, 13)).toEqual([9, 22, 35]);
    expect(standApart([120, 120], 9, 100, 13)).toEqual([100, 87]);
  });
});
