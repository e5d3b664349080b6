/** A gamepad with the standard layout: left stick probe, right stick needle, triggers push and pull. */

import type { Desk } from "../desk";
import type { ActionId } from "../keys";
import type { Knob } from "../protocol";

const DEAD_ZONE = 0.12;
const HOLD_RESET = 1000;
/** A trigger pulled through is twice the rate: 20 mm/s. */
const TRIGGER = 2;

const MENU = 9;
const [L3, R3] = [10, 11];
const ACTION_BUTTONS: readonly [number, ActionId][] = [[0, "freeze"], [1, "undo"], [2, "entry"], [3, "skin"], [8, "nextModel"]];

/** What a hand feels when something happens in the tissue. */
const PULSE = { duration: 120, strongMagnitude: 0.8, weakMagnitude: 0.4 };

type Pad = NonNullable<Knob["pad"]>;
/** Buttons that go down and up, a stick's axis and which way of it goes up, or levers that pull and push. */
type Control = { buttons: readonly [number, number] } | { stick: number; sign: 1 | -1 } | { levers: readonly [number, number] };

/** Sticks forward are away, upwards: their axes run towards the hand. */
const CONTROLS: Record<Pad, Control> = {
  "left stick across": { stick: 0, sign: 1 }, "left stick along": { stick: 1, sign: -1 },
  "right stick across": { stick: 2, sign: 1 }, "right stick along": { stick: 3, sign: -1 },
  bumpers: { buttons: [4, 5] }, triggers: { levers: [6, 7] },
  "d-pad along": { buttons: [12, 13] }, "d-pad across": { buttons: [14, 15] },
};

/** Nothing within the dead zone, then fine near the middle and full at the end. */
export function stick(value: number): number {
  const beyond = (Math.abs(value) - DEAD_ZONE) / (1 - DEAD_ZONE);
  return beyond <= 0 ? 0 : Math.sign(value) * Math.min(1, beyond) ** 3;
}

export class GamepadReader {
  private down = new Set<number>();
  private menuSince = 0;
  private id: string | null = null;

  constructor(private readonly desk: Desk) {
    desk.session.happened.on(() => void this.pad()?.vibrationActuator?.playEffect("dual-rumble", PULSE).catch(() => undefined));
  }

  private pad(pads: readonly (Gamepad | null)[] = navigator.getGamepads()): Gamepad | null {
    return pads.find((candidate) => candidate?.connected && candidate.mapping === "standard") ?? null;
  }

  /** Once an animation frame. */
  poll(now: number, pads: readonly (Gamepad | null)[] = navigator.getGamepads()): void {
    const pad = this.pad(pads);
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
    for (const { id, pad: name } of this.desk.session.scene?.knobs ?? []) {
      if (name) this.move(pad, id, CONTROLS[name], pressed, released);
    }
    if (pressed(L3) || pressed(R3)) this.desk.holdPace(this.down.has(L3) ? "slow" : "fast");
    if (released(L3) || released(R3)) this.desk.holdPace(null);
  }

  private move(pad: Gamepad, id: string, control: Control, pressed: (k: number) => boolean, released: (k: number) => boolean): void {
    if ("stick" in control) return this.desk.drive(`pad ${id}`, id, control.sign * stick(pad.axes[control.stick] ?? 0));
    if ("levers" in control) {
      const [pull, push] = control.levers.map((k) => pad.buttons[k]?.value ?? 0);
      const speed = TRIGGER * (push - pull);
      return this.desk.drive(`pad ${id}`, id, Math.abs(speed) < 0.04 ? 0 : speed);
    }
    for (const [k, button] of control.buttons.entries()) {
      if (pressed(button)) this.desk.press(`pad ${button}`, id, k ? 1 : -1);
      if (released(button)) this.desk.release(`pad ${button}`);
    }
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
