/** A gamepad with the standard layout: left stick probe, right stick needle, triggers push and pull. */

import type { AxisId } from "../axes";
import type { Desk } from "../desk";
import type { ActionId } from "../keys";

const DEAD_ZONE = 0.12;
const HOLD_RESET = 1000;
/** A trigger pulled through is twice the rate: 20 mm/s. */
const TRIGGER = 2;

const MENU = 9;
const [L3, R3] = [10, 11];
const ACTION_BUTTONS: readonly [number, ActionId][] = [[0, "freeze"], [1, "undo"], [2, "entry"], [3, "skin"], [8, "nextModel"]];
const AXIS_BUTTONS: readonly [number, AxisId, number][] = [
  [4, "rotate", -1], [5, "rotate", 1], [12, "depth", -1], [13, "depth", 1], [14, "fan", -1], [15, "fan", 1],
];
/** Sticks forward are away: a sweep or swing upwards. */
const STICKS: readonly [number, AxisId, number][] = [[0, "slide", 1], [1, "sweep", -1], [2, "angle", 1], [3, "swing", -1]];

/** Nothing within the dead zone, then fine near the middle and full at the end. */
export function stick(value: number): number {
  const beyond = (Math.abs(value) - DEAD_ZONE) / (1 - DEAD_ZONE);
  return beyond <= 0 ? 0 : Math.sign(value) * Math.min(1, beyond) ** 3;
}

export class GamepadReader {
  private down = new Set<number>();
  private menuSince = 0;
  private id: string | null = null;

  constructor(private readonly desk: Desk) {}

  /** Once an animation frame. */
  poll(now: number, pads: readonly (Gamepad | null)[] = navigator.getGamepads()): void {
    const pad = pads.find((candidate) => candidate?.connected && candidate.mapping === "standard") ?? null;
    if (!pad) {
      if (this.id !== null) this.desk.stop();
      this.id = null;
      this.down.clear();
      return;
    }
    this.id = pad.id;
    const before = this.down;
    this.down = new Set(pad.buttons.flatMap((button, k) => (button.pressed || button.value > 0.5 ? [k] : [])));
    const pressed = (k: number) => this.down.has(k) && !before.has(k);
    const released = (k: number) => !this.down.has(k) && before.has(k);
    this.menu(now, pressed(MENU), released(MENU));
    if (this.desk.switches.help) {
      if (pressed(1)) this.desk.run("close");
      return;
    }
    for (const [button, action] of ACTION_BUTTONS) if (pressed(button)) this.desk.run(action);
    for (const [button, axis, sign] of AXIS_BUTTONS) {
      if (pressed(button)) this.desk.press(`pad${button}`, axis, sign);
      if (released(button)) this.desk.release(`pad${button}`);
    }
    for (const [place, axis, sign] of STICKS) this.desk.drive(`stick${place}`, axis, sign * stick(pad.axes[place] ?? 0));
    const pull = TRIGGER * ((pad.buttons[7]?.value ?? 0) - (pad.buttons[6]?.value ?? 0));
    this.desk.drive("triggers", "push", Math.abs(pull) < 0.04 ? 0 : pull);
    if (pressed(L3) || pressed(R3)) this.desk.holdPace(this.down.has(L3) ? "slow" : "fast");
    if (released(L3) || released(R3)) this.desk.holdPace(null);
  }

  /** Menu: help when let go, reset when held for a second. */
  private menu(now: number, pressed: boolean, released: boolean): void {
    if (pressed) this.menuSince = now;
    if (this.menuSince && now - this.menuSince >= HOLD_RESET) {
      this.menuSince = 0;
      this.desk.run("reset");
    }
    if (released && this.menuSince) {
      this.menuSince = 0;
      this.desk.run("help");
    }
  }
}
