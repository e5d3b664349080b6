import { describe, expect, it } from "vitest";
import { HOLD_DELAY, Motion } from "../src/motion";
import { depth, gain, push, slide } from "./knobs";

const moved = (motion: Motion, seconds: number) => motion.advance(seconds).reduce((sum, { by }) => sum + by, 0);

describe("Motion", () => {
  it("makes one step at a tap and no more", () => {
    const motion = new Motion();
    expect(motion.press("ArrowDown", push, 1)).toEqual({ knob: push, by: 0.5 });
    expect(motion.press("ArrowDown", push, 1)).toBeNull();
    expect(moved(motion, 0.1)).toBe(0);
    motion.release("ArrowDown");
    expect(moved(motion, 5)).toBe(0);
  });

  it.each([[0.001], [0.016], [0.1], [0.3]])("moves at its rate after the delay, however long a frame takes (%f s)", (dt) => {
    const motion = new Motion();
    motion.press("d", slide, -1);
    let way = 0;
    let time = 0;
    while (time < HOLD_DELAY + 1 - 1e-9) {
      const step = Math.min(dt, HOLD_DELAY + 1 - time);
      way += moved(motion, step);
      time += step;
    }
    expect(way).toBeCloseTo(-20, 6);
  });

  it("is a fifth when slow, four times when fast, and what is held wins over what is chosen", () => {
    const motion = new Motion();
    motion.chosen = "fast";
    expect(motion.press("a", push, 1)?.by).toBe(2);
    motion.over = "slow";
    expect(motion.press("b", push, 1)?.by).toBeCloseTo(0.1);
    expect(motion.press("c", gain, 1)?.by).toBe(2);
  });

  it("moves settings from step to step", () => {
    const motion = new Motion();
    motion.press("]", depth, 1);
    const steps = Array.from({ length: 125 }, () => moved(motion, 0.01));
    expect(steps.every((by) => by === 0 || by === 10)).toBe(true);
    expect(steps.reduce((sum, by) => sum + by, 0)).toBe(40);
  });

  it("follows a lever's speed and stops with it", () => {
    const motion = new Motion();
    motion.drive("lever", push, 2);
    expect(moved(motion, 0.5)).toBeCloseTo(10);
    motion.drive("lever", push, 0);
    expect(motion.moving).toBe(false);
  });

  it("does not wind up against an end", () => {
    const motion = new Motion();
    motion.press("ArrowDown", push, 1);
    moved(motion, 1);
    motion.stopKnob(push.id, 1);
    expect(moved(motion, 1)).toBe(0);
  });
});
