/** Between hands and session: what is held, how fast, and the switches that are the page's own. */

import { AXES, limits, read, type AxisId } from "./axes";
import { Goals } from "./goals";
import type { ActionId } from "./keys";
import { Motion, PACE, type Pace } from "./motion";
import { RESTORE, type Session } from "./session";
import { Signal } from "./signal";
import { clamp } from "./vec";

export interface Switches {
  guides: boolean;
  grid: boolean;
  colours: boolean;
  probeView: boolean;
  /** The needle is out and its entry is being chosen. */
  placing: boolean;
  /** On a tablet: the 3-D view has the large place. */
  swapped: boolean;
  leftHanded: boolean;
  help: boolean;
}

const HAND = "sonospline-hand";

export class Desk {
  readonly motion = new Motion();
  private readonly goals = new Goals();
  /** Axes that hands moved steadily a moment ago. */
  private moved = new Set<AxisId>();
  readonly switches: Switches = {
    guides: true, grid: false, colours: false, probeView: false, placing: false, swapped: false,
    leftHanded: localStorage.getItem(HAND) === "left", help: false,
  };
  readonly switched = new Signal<Switches>();
  readonly paced = new Signal<Pace>();
  readonly said = new Signal<string>();
  /** A goal was set, reached or stopped. */
  readonly aimed = new Signal<void>();
  /** Reset can be taken back until then. */
  restoreUntil = 0;

  constructor(readonly session: Session) {
    session.statusChanged.on((status) => {
      if (status !== "live") this.stop();
    });
    session.sceneReady.on(() => this.flip("placing", false));
    session.commanded.on((command) => {
      if (command.needle.depth > 0 && this.goal("push") !== 0) this.flip("placing", false);
    });
    session.limited.on(([axis, sign]) => {
      this.motion.stopAxis(axis, sign);
      if (Math.sign((this.goal(axis) ?? 0) - session.shown(axis)) === sign) this.forget(axis);
    });
  }

  /** A held source goes down; the first step is made at once. */
  press(source: string, axis: AxisId, sign: number): void {
    if (!this.session.answers) return;
    const step = this.motion.press(source, this.steered(axis), sign);
    if (step) this.nudge(step.axis, step.by);
  }

  /** One step at once. */
  tap(axis: AxisId, sign: number): void {
    this.press("tap", axis, sign);
    this.release("tap");
  }

  /** A hand moves an axis: what it was going to is forgotten. */
  nudge(axis: AxisId, by: number): void {
    this.forget(axis);
    this.session.nudge(axis, by);
  }

  /** Go to a place at a speed, by default the chosen one; settings are there at once. */
  goTo(axis: AxisId, value: number, pace: Pace | null = null): void {
    if (!this.session.answers || !this.session.scene || !Number.isFinite(value)) return;
    if (AXES[axis].setting) return this.session.setAxis(axis, value);
    const [low, high] = limits(this.session.scene.limits, axis);
    this.goals.set(axis, clamp(value, low, high), pace);
    this.aimed.emit();
  }

  /** Where an axis is going; null where it goes nowhere. */
  goal(axis: AxisId): number | null {
    return this.goals.get(axis);
  }

  /** Stay where the picture is. */
  halt(axis: AxisId): void {
    if (this.goal(axis) === null) return;
    this.forget(axis);
    this.session.letGo(axis, PACE[this.motion.pace]);
  }

  private forget(axis: AxisId): void {
    if (this.goals.stop(axis)) this.aimed.emit();
  }

  release(source: string): void {
    this.motion.release(source);
  }

  drive(source: string, axis: AxisId, speed: number): void {
    const moves = this.session.answers && speed !== 0;
    if (moves) this.forget(this.steered(axis));
    this.motion.drive(source, this.steered(axis), moves ? speed : 0);
  }

  stop(): void {
    this.motion.stop();
    this.paced.emit(this.motion.pace);
    for (const axis of this.goals.axes) this.halt(axis);
  }

  /** Once an animation frame. */
  advance(seconds: number): void {
    const { motion, goals, session } = this;
    if (!session.answers) return this.moved.clear();
    for (const { axis, by } of motion.advance(seconds)) session.nudge(axis, by);
    const going = goals.axes.length;
    for (const { axis, by } of goals.advance(seconds, (axis) => session.value(axis), motion.pace)) session.nudge(axis, by);
    if (goals.axes.length < going) this.aimed.emit();
    const now = motion.steady;
    for (const axis of this.moved) if (!now.has(axis) && this.goal(axis) === null) session.letGo(axis, PACE[motion.pace]);
    this.moved = now;
  }

  choosePace(pace: Pace): void {
    this.motion.chosen = pace;
    this.paced.emit(this.motion.pace);
  }

  holdPace(pace: Pace | null): void {
    if (this.motion.over === pace) return;
    this.motion.over = pace;
    this.paced.emit(this.motion.pace);
  }

  flip(name: keyof Switches, on = !this.switches[name]): void {
    if (this.switches[name] === on) return;
    this.switches[name] = on;
    if (name === "placing" && !on) for (const axis of ["along", "across"] as const) this.forget(axis);
    if (name === "grid") this.session.setGrid(on);
    if (name === "leftHanded") localStorage.setItem(HAND, on ? "left" : "right");
    this.switched.emit(this.switches);
  }

  run(action: ActionId): void {
    const { session } = this;
    switch (action) {
      case "skin":
        return this.withdraw();
      case "entry":
        return this.place();
      case "undo":
        this.stop();
        return session.undoPass();
      case "recentre":
        return this.recentre();
      case "freeze":
        return session.toggleFreeze();
      case "reset":
        return this.reset();
      case "help":
        this.stop();
        return this.flip("help");
      case "close":
        this.stop();
        return this.flip(this.switches.help ? "help" : "placing", false);
      case "guides":
      case "grid":
      case "colours":
      case "probeView":
        return this.flip(action);
      case "nextModel":
        return this.chooseModel(this.nextModel());
      default:
        return this.chooseModel(Number(action.at(-1)) - 1);
    }
  }

  /** The needle goes out, and what turned it now moves its entry. */
  private place(): void {
    if (!this.session.answers) return;
    if (this.switches.placing) return this.flip("placing", false);
    this.withdraw();
    this.flip("placing", true);
    this.said.emit("New entry. Angle keys move it along the skin, swing keys across; push to go in.");
  }

  /** Out to the skin: nothing is aimed at on this way, so it goes fast. */
  private withdraw(): void {
    this.goTo("push", 0, "fast");
  }

  /** The probe back to where the scene put it. */
  private recentre(): void {
    const { scene } = this.session;
    if (scene) for (const axis of PROBE_AXES) this.goTo(axis, read(scene.start, axis), "fast");
  }

  private reset(): void {
    this.stop();
    this.restoreUntil = performance.now() + RESTORE;
    this.flip("placing", false);
    this.session.reset();
  }

  private chooseModel(place: number): void {
    const model = this.session.scene?.models[place];
    if (model) this.session.chooseModel(model.id);
  }

  private nextModel(): number {
    const models = this.session.scene?.models ?? [];
    const now = models.findIndex((model) => model.id === this.session.model);
    for (let k = 1; k <= models.length; k += 1) {
      if (models[(now + k) % models.length].available) return (now + k) % models.length;
    }
    return now;
  }

  private steered(axis: AxisId): AxisId {
    if (!this.switches.placing) return axis;
    return axis === "angle" ? "along" : axis === "swing" ? "across" : axis;
  }
}

/** The axes a stepper shows, in the order of the dock. */
export const PROBE_AXES = ["slide", "sweep", "rotate", "fan"] as const satisfies readonly AxisId[];
export const IMAGE_AXES = ["gain", "depth", "frequency", "focus"] as const satisfies readonly AxisId[];
