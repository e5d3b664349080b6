import { describe, expect, it } from "vitest";
import { Caution } from "../src/caution";
import { liveAddress, retryDelay } from "../src/connection";
import { axisTop, Curves } from "../src/curves";
import { stick } from "../src/input/gamepad";
import { bindings, keyOfKnob } from "../src/keys";
import { put, show, signless } from "../src/knobs";
import { Meter } from "../src/latency";
import { parts } from "../src/parts/words";
import type { FrameHeader, Scene } from "../src/protocol";
import { cividis, roundUp } from "../src/view3d/cividis";
import { framed, inSight } from "../src/view3d/framing";
import { adopt, limited, same } from "../src/command";
import { command, depth, focus, knob, push, rotate, slide } from "./knobs";

describe("numbers as they are shown", () => {
  it("has a true minus, no negative zero, and places only where they say something", () => {
    expect([signless("-0.0"), signless("-2.5")]).toEqual(["0.0", "\u22122.5"]);
    expect([show(depth, 120), show(focus, 65), show(rotate, -4), show(slide, 12)]).toEqual(["12", "6.5", "\u22124", "12.0"]);
  });

  it("says the two largest parts of a displacement", () => {
    expect(parts([1.8, 2.6, -0.3])).toBe("1.8 right, 2.6 deeper");
    expect(parts([0, 0.01, 0])).toBe("at rest");
    expect(parts(null)).toBe("");
  });
});

describe("commands", () => {
  it("stay within their limits", () => {
    expect(put(command, push, 200).needle.depth).toBe(150);
    expect(put(command, push, -1).needle.depth).toBe(0);
  });

  it("give way only where the server did not follow", () => {
    const sent = { ...command, needle: { ...command.needle, depth: 80, angle: 70 } };
    const state = { ...sent, needle: { ...sent.needle, depth: 76.5 } };
    const now = { ...sent, needle: { ...sent.needle, depth: 82, angle: 71 } };
    const next = adopt(now, sent, state);
    expect([next.needle.depth, next.needle.angle]).toEqual([76.5, 71]);
    expect(adopt(now, sent, sent)).toBe(now);
    expect(same(next, now)).toBe(false);
    expect(limited([push, slide], sent, state)).toEqual([[push, 1]]);
  });
});

describe("a knob that the page has never heard of", () => {
  const persistence = knob("image.persistence", { keys: ["KeyT", "KeyY"], low: 0, high: 4, step: 1 });
  const asked = { ...command, image: { ...command.image, persistence: 3 } };

  it("has its keys, which take none of the page's own", () => {
    const keys = bindings([push, persistence, knob("image.greedy", { keys: ["Space", "KeyJ"] })]);
    expect(keys.get("KeyY")).toEqual({ does: "knob", knob: persistence, sign: 1 });
    expect(keyOfKnob(persistence, -1)).toBe("T");
    expect(keys.get("Space")).toEqual({ does: "action", action: "freeze" });
  });

  it("is asked for within its limits, and gives way like all others", () => {
    expect(put(asked, persistence, 9).image).toEqual({ ...command.image, persistence: 4 });
    const state = put(asked, persistence, 2);
    expect(limited([push, persistence], asked, state)).toEqual([[persistence, 1]]);
    expect(adopt(asked, asked, state).image).toEqual(state.image);
    expect(same(asked, state)).toBe(false);
  });
});

describe("latency", () => {
  it("is the median of pose sent to its frame drawn, by number", () => {
    const meter = new Meter();
    [0, 10, 20].forEach((at, k) => meter.poseSent(k + 1, at));
    meter.frameDrawn(1, 30);
    meter.frameDrawn(3, 50);
    meter.frameDrawn(3, 60);
    expect(meter.latency(60)).toBe(30);
    expect(meter.rate(60)).toBe(3);
    expect(meter.rate(1055)).toBe(1);
  });
});

describe("cautions", () => {
  it("come after their delay and go 10 % below the limit", () => {
    const caution = new Caution(100, 300);
    expect([caution.update(120, 0), caution.update(120, 299), caution.update(120, 300)]).toEqual([false, false, true]);
    expect([caution.update(95, 400), caution.update(89, 500)]).toEqual([true, false]);
  });
});

describe("hands and links", () => {
  it("leaves a dead zone and cubes the rest", () => {
    expect([stick(0.1), stick(-0.12), stick(1), stick(-1)]).toEqual([0, 0, 1, -1]);
    expect(stick(0.56)).toBeCloseTo(0.125);
  });

  it("tries again after 0.5, 1, 2, 4, then every 5 s", () => {
    expect([1, 2, 3, 4, 5, 50].map(retryDelay)).toEqual([0.5, 1, 2, 4, 5, 5]);
  });

  it("finds the socket beside the page, with its token", () => {
    expect(liveAddress("http://127.0.0.1:8765/?token=abc#x")).toBe("ws://127.0.0.1:8765/live?token=abc");
    expect(liveAddress("https://host/a/?token=abc", "k-1")).toBe("wss://host/a/live?token=abc&session=k-1");
  });
});

describe("curves", () => {
  const header = (depth: number, moved: number, u = 0) => ({ readouts: { depth, moved }, state: { needle: { u, v: 0 } }, pass: { passes: Number(depth > 0) } }) as unknown as FrameHeader;
  it("keep one for each model until the entry changes", () => {
    const curves = new Curves();
    curves.add("paper", header(10, 1));
    curves.add("elastic", header(10, 0.5));
    curves.add("elastic", header(5, 0.2));
    expect(curves.get("elastic")).toEqual([[5, 0.2], [10, 0.5]]);
    curves.add("elastic", header(1, 0.1, 20));
    expect(curves.models).toEqual(["elastic"]);
    curves.add("elastic", header(0, 0, 20)); // after a reset
    expect(curves.get("elastic")).toEqual([[0, 0]]);
  });

  it("have round axes", () => {
    expect(axisTop(67, 80, 5)).toEqual({ top: 80, step: 20 });
    expect(axisTop(4.1, 2, 3)).toEqual({ top: 6, step: 2 });
    expect(axisTop(0, 2, 3)).toEqual({ top: 2, step: 1 });
  });
});

describe("the 3-D view", () => {
  it("has every point in sight", () => {
    const { centre, distance } = framed([[-50, -10, 0], [50, 10, 0]], [0, 0, 1], [0, 1, 0], 1);
    expect(centre).toEqual([0, 0, 0]);
    expect(50 / distance).toBeLessThan(Math.tan(Math.PI / 12));
  });

  it.each([[360 / 418], [336 / 324], [1], [254 / 344]])("has the needle's hub in sight at the start (aspect %f)", (aspect) => {
    const scene = {
      box: { low: [-60, -60, 0], high: [60, 60, 120] },
      frame: { right: [1, 0, 0], depth: [0, 0, 1], out: [0, -1, 0], skin_origin: [0, 0, 0] },
      start: { ...command, needle: { u: -60, v: 0, angle: 54, swing: 0, depth: 0 } },
      needle: { length_mm: 150, diameter_mm: 1 },
    } as unknown as Scene;
    const points = inSight(scene);
    const back = (150 + 7) * Math.sin((54 * Math.PI) / 180);
    expect(Math.min(...points.map(([, , z]) => z))).toBeCloseTo(-back - 6);
    const { centre, distance } = framed(points, [0, 1, 0], [0, 0, -1], aspect);
    const slope = Math.tan(Math.PI / 12);
    for (const [x, y, z] of points) {
      const far = centre[1] + distance - y;
      expect(Math.abs(z - centre[2]) / far).toBeLessThan(slope);
      expect(Math.abs(x - centre[0]) / far).toBeLessThan(slope * aspect);
    }
  });

  it("begins its colours at 22 % and ends at yellow", () => {
    const colour = [0, 0, 0];
    cividis(1, colour, 0);
    expect(colour[0]).toBeGreaterThan(0.98);
    expect([roundUp(0.3), roundUp(3.2), roundUp(5)]).toEqual([0.5, 5, 5]);
  });
});
