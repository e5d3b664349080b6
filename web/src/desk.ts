/** Between hands and session: what is held, how fast, and the switches that are the page's own. */

import { Goals } from "./goals";
import { bindings, type ActionId, type Binding } from "./keys";
import { ACROSS, ALONG, ANGLE, PRESS, PUSH, read, SWING } from "./knobs";
import { Motion, PACE, type Pace } from "./motion";
import { RESTORE, type Session } from "./session";
import type { Trainer } from "./trainer";
import { Signal } from "./signal";
import type { TissueSwitch } from "./tissue";
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
  /** The image's left is on the right. */
  mirrored: boolean;
}

const HAND = "sonospline-hand";

export class Desk {
  readonly motion = new Motion();
  private readonly goals = new Goals();
  /** Knobs that hands moved steadily a moment ago. */
  private moved = new Set<string>();
  /** What the keys do in this scene. */
  keys: ReadonlyMap<string, Binding> = bindings([]);
  readonly switches: Switches = {
    guides: true, grid: false, colours: false, probeView: false, placing: false, swapped: false,
    leftHanded: localStorage.getItem(HAND) === "left", help: false, mirrored: false,
  };
  readonly switched = new Signal<Switches>();
  readonly paced = new Signal<Pace>();
  readonly said = new Signal<string>();
  /** A goal was set, reached or stopped. */
  readonly aimed = new Signal<void>();
  /** Reset can be taken back until then. */
  restoreUntil = 0;

  constructor(
    readonly session: Session,
    readonly trainer: Trainer,
  ) {
    session.statusChanged.on((status) => {
      if (status !== "live") this.stop();
    });
    session.sceneReady.on((scene) => {
      this.keys = bindings(scene.knobs);
      this.flip("placing", false);
    });
    session.commanded.on((command) => {
      if (command.needle.depth > 0 && this.goal(PUSH) !== 0) this.flip("placing", false);
    });
    session.limited.on(([{ id }, sign]) => {
      this.motion.stopKnob(id, sign);
      if (Math.sign((this.goal(id) ?? 0) - session.shown(id)) === sign) this.forget(id);
    });
  }

  /** A held source goes down; the first step is made at once. */
  press(source: string, id: string, sign: number): void {
    if (!this.session.answers) return;
    const step = this.motion.press(source, this.session.knob(this.steered(id)), sign);
    if (step) this.nudge(step.knob.id, step.by);
  }

  /** One step at once. */
  tap(id: string, sign: number): void {
    this.press("tap", id, sign);
    this.release("tap");
  }

  /** A hand moves a knob: what it was going to is forgotten. */
  nudge(id: string, by: number): void {
    this.forget(id);
    if (id === PRESS && by > 0 && this.session.command?.tissue?.probe === "looks") this.turn("press");
    this.session.nudge(id, by);
  }

  /** Go to a place at a speed, by default the chosen one; settings are there at once. */
  goTo(id: string, value: number, pace: Pace | null = null): void {
    if (!this.session.answers || !Number.isFinite(value)) return;
    const knob = this.session.knob(id);
    if (knob.setting) return this.session.setKnob(id, value);
    this.goals.set(knob, clamp(value, knob.low, knob.high), pace);
    this.aimed.emit();
  }

  /** Where a knob is going; null where it goes nowhere. */
  goal(id: string): number | null {
    return this.goals.get(id);
  }

  /** Stay where the picture is. */
  halt(id: string): void {
    if (this.goal(id) === null) return;
    this.forget(id);
    this.session.letGo(id, PACE[this.motion.pace]);
  }

  private forget(id: string): void {
    if (this.goals.stop(id)) this.aimed.emit();
  }

  release(source: string): void {
    this.motion.release(source);
  }

  drive(source: string, id: string, speed: number): void {
    if (!this.session.answers || speed === 0) return this.motion.release(source);
    this.forget(this.steered(id));
    this.motion.drive(source, this.session.knob(this.steered(id)), speed);
  }

  stop(): void {
    this.motion.stop();
    this.paced.emit(this.motion.pace);
    for (const id of this.goals.ids) this.halt(id);
  }

  /** Once an animation frame. */
  advance(seconds: number): void {
    const { motion, goals, session } = this;
    if (!session.answers) return this.moved.clear();
    for (const { knob, by } of motion.advance(seconds)) session.nudge(knob.id, by);
    const going = goals.ids.length;
    for (const { knob, by } of goals.advance(seconds, ({ id }) => session.value(id), motion.pace)) session.nudge(knob.id, by);
    if (goals.ids.length < going) this.aimed.emit();
    const now = motion.steady;
    for (const id of this.moved) if (!now.has(id) && this.goal(id) === null) session.letGo(id, PACE[motion.pace]);
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
    if (name === "placing" && !on) for (const id of [ALONG, ACROSS]) this.forget(id);
    if (name === "grid") this.session.look({ grid: on });
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
        if (this.trainer.attempt) return this.said.emit("Not in an exercise: pull the needle back.");
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
      case "breathe":
      case "hold":
      case "remember":
      case "relax":
      case "press":
        return this.turn(action);
      case "onTarget":
        return this.trainer.sayOnTarget();
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
    this.goTo(PUSH, 0, "fast");
  }

  /** The probe back to where the scene put it. */
  private recentre(): void {
    const { scene } = this.session;
    if (!scene) return;
    for (const knob of scene.knobs) if (knob.group === "probe") this.goTo(knob.id, read(scene.start, knob), "fast");
  }

  private reset(): void {
    if (this.trainer.attempt) return this.said.emit("Not in an exercise: give up, or try again.");
    this.stop();
    this.restoreUntil = performance.now() + RESTORE;
    this.flip("placing", false);
    this.session.reset();
  }

  private turn(id: TissueSwitch): void {
    const why = this.session.turn(id);
    if (why) this.said.emit(`${why}.`);
  }

  private chooseModel(place: number): void {
    const model = this.session.scene?.models[place];
    if (model && !this.trainer.attempt) this.session.chooseModel(model.id);
  }

  private nextModel(): number {
    const models = this.session.scene?.models ?? [];
    const now = models.findIndex((model) => model.id === this.session.model);
    return (now + 1) % models.length;
  }

  private steered(id: string): string {
    if (!this.switches.placing) return id;
    return id === ANGLE ? ALONG : id === SWING ? ACROSS : id;
  }
}
