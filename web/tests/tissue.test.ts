import { describe, expect, it } from "vitest";
import { happening } from "../src/parts/words";
import type { FrameHeader, Scene } from "../src/protocol";
import { inShort, isOn, STILL, SWITCHES, turned, unavailable } from "../src/tissue";
import { Traces } from "../src/traces";

const models = [{ id: "paper", name: "Paper spline", time: false, forces: false }, { id: "elastic", name: "Elastic", time: true, forces: true }];
const scene = { models, breathes: true } as unknown as Scene;
const still = { models, breathes: false } as unknown as Scene;

describe("what tissue does in time", () => {
  it("goes on and off again", () => {
    for (const { id } of SWITCHES.filter(({ id: one }) => one !== "hold" && one !== "relax")) {
      expect(isOn(turned(STILL, id), id)).toBe(true);
      expect(turned(turned(STILL, id), id)).toEqual(STILL);
    }
  });

  it("relaxes only where needles leave tracks", () => {
    const relaxed = turned(STILL, "relax");
    expect(relaxed).toEqual({ contact: "track", relaxation: "tissue", breathing: "none", probe: "looks" });
    expect(turned(relaxed, "remember")).toEqual(STILL);
    expect(turned(relaxed, "relax")).toEqual({ ...relaxed, relaxation: "none" });
  });

  it("holds the breath of somebody who breathes", () => {
    const breathing = turned(STILL, "breathe");
    expect(turned(breathing, "hold").breathing).toBe("held");
    expect(turned(turned(breathing, "hold"), "hold")).toEqual(breathing);
    expect(turned(turned(breathing, "hold"), "breathe")).toEqual(STILL);
  });

  it("says why a switch does nothing", () => {
    expect(unavailable(scene, "paper", STILL, "remember")).toBe("Paper spline knows no time");
    expect(unavailable(still, "elastic", STILL, "breathe")).toBe("This scene does not breathe");
    expect(unavailable(scene, "elastic", STILL, "hold")).toBe("Nobody breathes");
    expect(unavailable(still, "elastic", STILL, "remember")).toBeNull();
    expect(unavailable(scene, "elastic", turned(STILL, "breathe"), "hold")).toBeNull();
  });

  it("is named in a word or two", () => {
    const breathing = turned(STILL, "breathe");
    expect(inShort(scene, "elastic", STILL, 0)).toBe("Still");
    expect(inShort(scene, "elastic", breathing, 11.26)).toBe("Breath 11 mm");
    expect(inShort(scene, "elastic", turned(breathing, "hold"), 5)).toBe("Held 5 mm");
    expect(inShort(scene, "elastic", turned(STILL, "remember"), 0)).toBe("Remembers");
    expect(inShort(scene, "paper", breathing, 0)).toBe("No time");
    expect(inShort(scene, "elastic", turned(STILL, "press"), 0, 4.26)).toBe("Probe 4.3 N");
    expect(inShort(scene, "elastic", STILL, 3)).toBe("Breath 3 mm"); // the last breath is drawn out
  });

  it("has events in words", () => {
    expect(happening('punctured "renal capsule" at 1.2 N')).toEqual(["Punctured", "renal capsule at 1.2 N"]);
    expect(happening('left "skin"')).toEqual(["Left", "skin"]);
    expect(happening('touched "rib 11"')).toBeNull();
    expect(happening("something of another model")).toEqual(["Something of another model", ""]);
  });
});

describe("the trace of a force", () => {
  const at = (depth: number, axial_n: number | null, passes = 1) =>
    ({ readouts: { depth, hub: axial_n === null ? null : { axial_n } }, pass: { passes } }) as unknown as FrameHeader;

  it("is one line in and another out", () => {
    const traces = new Traces();
    for (const [depth, force] of [[0, 0], [5, 1], [10, 2], [5, -1], [0, 0]]) traces.add("elastic", at(depth, force));
    expect(traces.get("elastic")).toEqual([[0, 0], [5, 1], [10, 2], [5, -1], [0, 0]]);
  });

  it("leaves out what is on the last point, and begins anew with a pass", () => {
    const traces = new Traces();
    for (const force of [1, 1.01, 1.04, 1.2]) traces.add("elastic", at(3, force));
    expect(traces.get("elastic")).toEqual([[3, 1], [3, 1.2]]);
    traces.add("elastic", at(1, 0.5, 2));
    expect(traces.get("elastic")).toEqual([[1, 0.5]]);
  });

  it("is none where a model knows no forces", () => {
    const traces = new Traces();
    traces.add("paper", at(3, null));
    expect(traces.models).toEqual([]);
  });
});
