import { describe, expect, it } from "vitest";
import { Goals } from "../src/goals";
import { bounded, letGo, mostAhead } from "../src/lead";
import { Motion } from "../src/motion";
import { gain, push, rotate, slide } from "./knobs";

describe("the lead of what is asked over what is shown", () => {
  it("is at most 2 mm of needle, slide and sweep, and one fast tap of an angle", () => {
    expect([mostAhead(push), mostAhead(slide)]).toEqual([2, 2]);
    expect([mostAhead(rotate)]).toEqual([4]);
    expect(mostAhead(gain)).toBe(Infinity);
  });

  it.each([[0.1], [1], [120]])("stays bounded both ways, whatever the move (%f mm)", (by) => {
    let [down, up] = [10, 10];
    for (let k = 0; k < 200; k += 1) {
      down = bounded(push, down, by, 10);
      up = bounded(push, up, -by, 10);
    }
    expect([down, up]).toEqual([12, 8]);
  });

  it("lets what is ahead already come back, and pulls nothing back by itself", () => {
    expect(bounded(push, 30, 1, 10)).toBe(30);
    expect(bounded(push, 30, -1, 10)).toBe(29);
    expect(bounded(push, 30, 0, 10)).toBe(30);
  });

  it("is at most one tap once the hand lets go; settings stay", () => {
    expect(letGo(push, 12, 10, 1)).toBe(10.5);
    expect(letGo(push, 10.3, 10, 1)).toBe(10.3);
    expect(letGo(push, 8, 10, 0.2)).toBe(9.9);
    expect(letGo(gain, 12, 0, 1)).toBe(12);
  });
});

describe("goals", () => {
  const walk = (goals: Goals, from: number, seconds: number, pace: "slow" | "normal" | "fast" = "normal") => {
    let at = from;
    for (let k = 0; k < Math.round(seconds * 50); k += 1) for (const { by } of goals.advance(0.02, () => at, pace)) at += by;
    return at;
  };

  it("are gone to at the chosen speed and end where they are reached", () => {
    const goals = new Goals();
    goals.set(push, 15, null);
    expect(walk(goals, 0, 1)).toBeCloseTo(10);
    expect(walk(goals, 10, 1)).toBeCloseTo(15);
    expect(goals.get(push.id)).toBeNull();
    goals.set(push, 15, null);
    expect(walk(goals, 0, 1, "slow")).toBeCloseTo(2);
    goals.set(push, 0, "fast");
    expect(walk(goals, 90, 1)).toBeCloseTo(50);
  });

  it("are replaced by a second one and forgotten when stopped", () => {
    const goals = new Goals();
    goals.set(push, 60, null);
    goals.set(push, 2, null);
    expect(walk(goals, 10, 1)).toBeCloseTo(2);
    goals.set(push, 60, null);
    expect(goals.stop(push.id)).toBe(true);
    expect(walk(goals, 10, 1)).toBe(10);
  });
});

describe("hands", () => {
  it("push no faster together than one alone, and two ways at once not at all", () => {
    const motion = new Motion();
    motion.press("ArrowDown", push, 1);
    motion.press("button", push, 1);
    motion.advance(1);
    expect(motion.advance(1)).toEqual([{ knob: push, by: 10 }]);
    motion.press("ArrowUp", push, -1);
    motion.advance(1);
    expect(motion.advance(1).reduce((sum, { by }) => sum + by, 0)).toBe(0);
  });

  it("have a lever stand still at an end until it turns back", () => {
    const motion = new Motion();
    motion.drive("lever", push, 1);
    motion.stopKnob(push.id, 1);
    motion.drive("lever", push, 0.5);
    expect(motion.advance(1)).toEqual([]);
    motion.drive("lever", push, -0.5);
    expect(motion.advance(1)).toEqual([{ knob: push, by: -5 }]);
    motion.drive("lever", push, 0.5);
    expect(motion.advance(1)).toEqual([{ knob: push, by: 5 }]);
  });

  it("know which knobs move by themselves", () => {
    const motion = new Motion();
    motion.press("ArrowDown", push, 1);
    expect([...motion.steady]).toEqual([]);
    motion.advance(1);
    motion.drive("stick", slide, 0.2);
    expect([...motion.steady]).toEqual([push.id, slide.id]);
  });
});
