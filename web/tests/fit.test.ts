import { describe, expect, it } from "vitest";
import { roomBeside } from "../src/image/corner";
import { fit, Mapping } from "../src/image/fit";
import { inside, intoSight, needleInImage, pathAhead, reach, skinLine } from "../src/image/geometry";
import { parallel, sector } from "../src/image/sector";
import { chooseLayout, keep, margins } from "../src/layouts";
import { standApart } from "../src/plotLabels";
import type { NeedlePlace, ProbeOutline, SkinDirections, TargetPlace } from "../src/protocol";

const raster = { columns: 512, rows: 364, pixel: [0.35, 0.35] as const };
/** Beams square to an arc of a radius, over an angle; a radius of 0 has them start at one point. */
const fan = (radius: number, degrees: number): ProbeOutline => ({
  name: "C5-2", face_radius_mm: radius, width_mm: 65, thickness_mm: 21,
  beams: Array.from({ length: 49 }, (_, k) => {
    const angle = (degrees * Math.PI * (k / 24 - 1)) / 360;
    const [x, y] = [Math.sin(angle), Math.cos(angle)];
    return [radius * x, radius * (y - 1), x, y];
  }),
});
const straight: ProbeOutline = { name: "L12", face_radius_mm: 0, width_mm: 43, thickness_mm: 16, beams: [[-19, 0, 0, 1], [19, 0, 0, 1]] };
const frame: SkinDirections = { right: [1, 0, 0], depth: [0, 0, 1], out: [0, -1, 0], skin_origin: [10, 20, 0] };
/** x right, y deep, z = x cross y; the image's origin 50 mm left of the skin's. */
const IMAGE = [1, 0, 0, -40, 0, 0, -1, 20, 0, 1, 0, 0, 0, 0, 0, 1];

describe("a mirrored image", () => {
  const box = { left: 30, top: 20, width: 512, height: 364 };
  const [plain, mirrored] = [false, true].map((turned) => new Mapping(box, raster, { width: 600, height: 400 }, turned));

  it("has every place as far from the other side, and comes back to itself", () => {
    for (const place of [[0, 0], [40, 12.5], [170, 100]]) {
      const [x, y] = plain.point(place);
      const [turned, same] = mirrored.point(place);
      expect(turned).toBeCloseTo(2 * box.left + box.width - x, 9);
      expect(same).toBe(y);
      mirrored.back([turned, same]).forEach((value, axis) => expect(value).toBeCloseTo(place[axis], 9));
    }
    expect(mirrored.turned([0.6, 0.8])).toEqual([-0.6, 0.8]);
  });
});

describe("fit", () => {
  it("keeps the aspect, grows as far as the height allows and leaves the read-outs free", () => {
    const pane = { width: 1080, height: 704 };
    const box = fit(pane, raster, margins("desktop", false), keep("desktop", false));
    expect(box.height).toBeCloseTo(644);
    expect(box.width / box.height).toBeCloseTo(512 / 364);
    expect(box.left).toBe(52);
  });

  it("goes to the other side where the needle comes from the right", () => {
    const box = fit({ width: 1080, height: 704 }, raster, margins("desktop", false), keep("desktop", true));
    expect(box.left + box.width).toBeCloseTo(1060);
  });

  it("leaves margins beside parallel beams", () => {
    const box = fit({ width: 1080, height: 704 }, { columns: 100, rows: 131, pixel: [0.38, 0.38] }, margins("desktop", true));
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
    const { face, deep, low, high } = sector(fan(60, 60), 120);
    expect(face[0][0]).toBeCloseTo(-30);
    expect(face[24]).toEqual([0, 0]);
    expect(deep[24][1]).toBeCloseTo(120);
    expect(high[0] - low[0]).toBeCloseTo(180);
  });

  it("begins in one point where the beams do", () => {
    expect(sector(fan(0, 80), 140).face).toHaveLength(1);
  });

  it("is a rectangle where they run side by side", () => {
    expect(sector(straight, 45).outline).toEqual([[-19, 0], [19, 0], [19, 45], [-19, 45]]);
    expect([parallel(straight), parallel(fan(60, 60)), parallel(fan(0, 80))]).toEqual([true, false, false]);
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
    const path = pathAhead(header.needle as NeedlePlace, header.target as TargetPlace, 5);
    expect(path?.end).toEqual([0, 0, 23]);
    expect(path?.ticks).toHaveLength(2);
    const beyond = { ...header.target, now: [0, 0, 5] };
    expect(pathAhead(header.needle as NeedlePlace, beyond as TargetPlace, 5)).toBeNull();
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
