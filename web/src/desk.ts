/** Between hands and session: what is held, how fast, and the switches that are the page's own. */

import type { AxisId } from "./axes";
import type { CommandId } from "./keys";
import { Motion, type Pace } from "./motion";
import { RESTORE, type Session } from "./session";
import { Signal } from "./signal";

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
  readonly switches: Switches = {
    guides: true, grid: false, colours: false, probeView: false, placing: false, swapped: false,
    leftHanded: localStorage.getItem(HAND) === "left", help: false,
  };
  readonly switched = new Signal<Switches>();
  readonly paced = new Signal<Pace>();
  readonly said = new Signal<string>();
  /** Reset can be taken back until then. */
  restoreUntil = 0;

  constructor(readonly session: Session) {
    session.statusChanged.on((status) => {
      if (status !== "live") this.stop();
    });
    session.sceneReady.on(() => this.flip("placing", false));
    session.wished.on((wish) => {
      if (wish.needle.depth > 0) this.flip("placing", false);
    });
    session.drawn.on(({ header }) => {
      if (header.blocked && header.blocked !== "needle inside") this.motion.stopAxis("push", 1);
    });
  }

  /** A held source goes down; the first step is made at once. */
  press(source: string, axis: AxisId, sign: number): void {
    if (!this.session.answers) return;
    const step = this.motion.press(source, this.steered(axis), sign);
    if (step) this.session.nudge(step.axis, step.by);
  }

  release(source: string): void {
    this.motion.release(source);
  }

  drive(source: string, axis: AxisId, speed: number): void {
    this.motion.drive(source, this.steered(axis), this.session.answers ? speed : 0);
  }

  stop(): void {
    this.motion.stop();
    this.paced.emit(this.motion.pace);
  }

  /** Once an animation frame. */
  advance(seconds: number): void {
    if (!this.motion.moving || !this.session.answers) return;
    for (const { axis, by } of this.motion.advance(seconds)) this.session.nudge(axis, by);
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
    if (name === "grid") this.session.setGrid(on);
    if (name === "leftHanded") localStorage.setItem(HAND, on ? "left" : "right");
    this.switched.emit(this.switches);
  }

  run(command: CommandId): void {
    const { session } = this;
    switch (command) {
      case "skin":
        return session.setAxis("push", 0);
      case "entry":
        return this.place();
      case "undo":
        this.stop();
        return session.undoPass();
      case "recentre":
        return session.recentre();
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
        return this.flip(command);
      case "nextModel":
        return this.chooseModel(this.nextModel());
      default:
        return this.chooseModel(Number(command.at(-1)) - 1);
    }
  }

  /** The needle goes out, and what turned it now moves its entry. */
  private place(): void {
    if (!this.session.answers) return;
    if (this.switches.placing) return this.flip("placing", false);
    this.session.setAxis("push", 0);
    this.flip("placing", true);
    this.said.emit("New entry. Angle keys move it along the skin, swing keys across; push to go in.");
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
